"""Robots with elastic joints: the engine's model of them, their geometry as built, how they start and how
they rest.

The host's table stays the nominal one, by which everything is planned; the arm's own differs from it by what
its calibration has left. That is the same as an arm with any table whose host has one as close to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array, parts_between, two_waves
from polish_sim.cell.gears import HostArm, RealArm, build_host_arm, with_error
from polish_sim.cell.scene import bend_links, links_of, tool_on_flange
from polish_sim.config import RealArmConfig, RobotConfig
from polish_sim.errors import ConfigError
from polish_sim.motion.kinematics import NOMINAL, link_frames, table_slopes, use_arm
from polish_sim.scenario_file import check_words

_STREAM = 17  # of the scenario's seed, for what is drawn of the arms themselves
# share of a joint's inertia its gear's stiffness may have in a step without more damping
_LIGHT = 0.25
_TARGETS = np.array([[0.0, 0.0, 0.22, 1.0], [0.15, 0.0, 0.1, 1.0], [0.0, 0.15, 0.1, 1.0]])
"""Points on the tool that a calibration measures, flange frame [m]."""
AROUND = np.array([0.5, 0.4, 0.5, 0.6, 0.6, 1.0])
"""How far joints are from where the work starts in the poses of a calibration, at most [rad]."""
#: Way of every joint to a pose that is reached from a known side, and its largest acceleration there
APPROACH_RAD, APPROACH_RAD_S2 = 0.3, 5.0
_INSTANTS = 16  # of such a way at which the gears are looked at


class ArmPlace(NamedTuple):
    """Where an arm is in a scene."""

    first: int = 0  #: Of its joints
    first_control: int = 0  #: Of its servos' controls
    number: int = 0  #: Among the arms of a seed, which draws each for itself

    @property
    def joints(self) -> slice:
        """Its joints in the engine."""
        return slice(self.first, self.first + 6)

    def rng(self, seed: int, what: int) -> np.random.Generator:
        """Draws of this arm: 0 its table, 1 its gears."""
        return np.random.default_rng([seed, _STREAM, 2 * self.number + what])


LONE = ArmPlace()


def take_arm(robot: RobotConfig) -> None:
    """Refuse words of a robot's settings that are not known, and knees in the wrong order; the process
    computes with this robot's arm from here on.

    Raises:
        PolishSimError: Naming the key.
    """
    real = robot.real
    check_words(robot, "robot.")
    if np.any(np.array(real.knee_2_nm) <= real.knee_1_nm):
        raise ConfigError("robot.real.knee_2_nm must be above robot.real.knee_1_nm in every joint.")
    use_arm(robot.arm)


def gear_twists(real: RealArmConfig, torque: Array) -> Array:
    """Twist of the gears' springs, shape (n, 6) [rad], under torques of that shape [N m]."""
    parts = parts_between(torque, (real.knee_1_nm, real.knee_2_nm))
    return np.sum(parts / gear_stiffness(real)[:, None], axis=0)


def gear_stiffness(real: RealArmConfig) -> Array:
    """Of the gears below, between and above the knees, shape (3, 6) [N m/rad]."""
    return np.array([real.stiffness_1_nm_rad, real.stiffness_2_nm_rad, real.stiffness_3_nm_rad])


def weights(model: mujoco.MjModel, q: Array, place: ArmPlace = LONE, speeding: Array | float = 0.0) -> Array:
    """Torques that hold the weight of an arm and what it carries, shape (n, 6) [N m], at its joints (n, 6)
    [rad], which accelerate by ``speeding`` (n, 6) [rad/s^2]."""
    data, torques, result = mujoco.MjData(model), np.empty_like(q), np.empty(model.nv)
    for k, (joints, rates) in enumerate(zip(q, np.broadcast_to(speeding, q.shape), strict=True)):
        data.qpos[place.joints] = joints
        mujoco.mj_forward(model, data)
        data.qacc[:] = 0.0
        data.qacc[place.joints] = rates
        mujoco.mj_rne(model, data, 1, result)
        torques[k] = result[place.joints]
    return torques


class RestingArm(NamedTuple):
    """An arm that stands still behind its gears, as calibrations see it."""

    real: RealArmConfig
    errors: Array  #: Of its gears, as `gear_errors`
    model: mujoco.MjModel  #: Weighs it
    place: ArmPlace = LONE

    def links(self, q: Array, rng: np.random.Generator | None = None) -> Array:
        """Joint angles (n, 6) [rad] with the encoders there; how far each gear has slipped is drawn; None:
        not."""
        if self.real.servo_side == "link":
            return q
        return self._behind(q, self._slipped(q, rng))

    def arrive(self, q: Array, rng: np.random.Generator) -> Array:
        """Joint angles (k, n, 6) [rad] with the encoders at ``q`` after all joints came from below, and then
        from above.

        They move along a cycloid. Meanwhile the hysteresis, drawn at first, follows the torque that carries
        weight and acceleration. Read on the links' side, one arrival is as good as two.
        """
        if self.real.servo_side == "link":
            return q[None]
        turn = np.linspace(0.0, 2.0 * np.pi, _INSTANTS)[:, None, None] + np.zeros(q.shape)
        left, rate = 1.0 - (turn - np.sin(turn)) / (2.0 * np.pi), APPROACH_RAD_S2 * np.sin(turn)
        slipped = self._slipped(q, rng)
        found = []
        for side in (1.0, -1.0):
            way = (q - side * APPROACH_RAD * left).reshape(-1, 6)
            carried = weights(self.model, way, self.place, side * rate.reshape(-1, 6))
            slipped = slip_along(self.real, carried.reshape(turn.shape), slipped)
            found.append(self._behind(q, slipped))
        return np.stack(found)

    def _behind(self, q: Array, slipped: Array) -> Array:
        turned = q + self._error(q)
        at = q
        for _ in range(3):
            at = turned - self._hanging(at, slipped)
        return at

    def weight(self, q: Array) -> Array:
        """Torques that hold its weight, (n, 6) [N m], as its robot knows them."""
        return weights(self.model, q, self.place)

    def encoders(self, q: Array, rng: np.random.Generator | None = None) -> Array:
        """What the encoders say, (n, 6) [rad], with the joints there; ``rng`` as in `links`."""
        read = q
        if self.real.servo_side == "motor":
            hanging = self._hanging(q, self._slipped(q, rng))
            for _ in range(6):
                read = q + hanging - self._error(read)
        step = self.real.encoder_rad
        return np.round(read / step) * step if step else read

    def _error(self, angle: Array) -> Array:
        return np.sum(two_waves(2.0 * self.real.gear_ratio * angle) * self.errors, axis=-1)

    def _slipped(self, q: Array, rng: np.random.Generator | None) -> Array:
        return np.zeros_like(q) if rng is None else lost_torque(self.real) * rng.uniform(-1.0, 1.0, q.shape)

    def _hanging(self, q: Array, slipped: Array) -> Array:
        return gear_twists(self.real, weights(self.model, q, self.place) - slipped)


def slip_along(real: RealArmConfig, torques: Array, slipped: Array) -> Array:
    """Torques of the hysteresis (n, 6) [N m] after the gears carried ``torques`` (m, n, 6) one after the
    other: `gears.slip` with the twist each change makes."""
    stiffness = gear_stiffness(real)
    first, second, rise = real.knee_1_nm, real.knee_2_nm, real.lost_motion_rise_rad
    spring = torques[0] - slipped
    for torque in torques[1:]:
        size, left = np.abs(spring), torque - spring - slipped
        slope = np.where(size < first, stiffness[0], np.where(size < second, stiffness[1], stiffness[2]))
        most = np.copysign(lost_torque(real), left)
        twisted = left / (slope + np.abs(most - slipped) / rise)
        spring = spring + slope * twisted
        slipped = most + (slipped - most) * np.exp(-np.abs(twisted) / rise)
    return slipped


def resting_arm(real: RealArmConfig, seed: int, model: mujoco.MjModel, place: ArmPlace = LONE) -> RestingArm:
    """The arm `build_real_arm` builds there, at rest."""
    return RestingArm(real, gear_errors(real, place.rng(seed, 1)), model, place)


def lost_torque(real: RealArmConfig) -> Array:
    """Largest torques of the hysteresis, shape (6,) [N m]."""
    return 0.5 * np.array(real.lost_motion_rad) * gear_stiffness(real)[0]


def built_table(
    real: RealArmConfig, seed: int, model: mujoco.MjModel, q_start: Array, place: ArmPlace = LONE
) -> Array:
    """Table of the arm as built, (4, 6), given that its host's is the nominal one; ``model`` weighs it.

    Calibrated: points on the tool are measured in random poses around the work at ``q_start`` (6,) [rad], the
    weight acting, and a table is fitted; the arm's is the nominal one plus what that fit got wrong.
    Uncalibrated: the errors as they were built.
    """
    if real.kinematics == "exact":
        return NOMINAL.copy()
    rng = place.rng(seed, 0)
    sizes = np.array([real.angle_error_rad, real.length_error_m, real.length_error_m, real.angle_error_rad])
    built = sizes[:, None] * rng.standard_normal((4, 6))
    if real.kinematics == "uncalibrated":
        return NOMINAL + built
    q = q_start + AROUND * rng.uniform(-1.0, 1.0, (real.calibration_poses, 6))
    # The encoders are at q; joints behind the motors' hang back by what the gears wind up.
    hanging = gear_twists(real, weights(model, q, place)) if real.servo_side == "motor" else np.zeros_like(q)
    points = _points(q - hanging, NOMINAL + built)
    off = points - _points(q, NOMINAL) + real.calibration_noise_m * rng.standard_normal(points.shape)
    frames = np.repeat(link_frames(q), len(_TARGETS), axis=0)
    slopes = table_slopes(frames, _points(q, NOMINAL).reshape(-1, 3)).reshape(-1, 24)
    fitted = np.linalg.lstsq(slopes, off.ravel(), rcond=1e-9)[0]
    return NOMINAL + built - fitted.reshape(4, 6)


def _points(q: Array, table: Array) -> Array:
    """Points on the tool, shape (n, 3, 3) [m]: pose, point, coordinate."""
    return (link_frames(q, table)[:, 6, None] @ _TARGETS[:, :, None])[..., :3, 0]


def build_real_arm(
    real: RealArmConfig,
    seed: int,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    q_start: Array,
    host: HostArm | None = None,
) -> RealArm:
    """The one robot of a scene, bent as built; ``host``: one that knows its arm, None: it has the nominal
    table and its tool; see `build_joints`."""
    links = links_of(model)
    bend_links(
        links, [model.joint(int(link.jntadr[0])) for link in links], built_table(real, seed, model, q_start)
    )
    host = host or build_host_arm(NOMINAL, np.eye(4), tool_on_flange())
    return build_joints(real, seed, model, data, q_start, host)


def build_joints(
    real: RealArmConfig,
    seed: int,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    q_start: Array,
    host: HostArm,
    place: ArmPlace = LONE,
) -> RealArm:
    """Joints at rest with their encoders at ``q_start`` (6,) [rad], the arm as its ``host`` computes it.

    The model becomes one of links without servos, rotors and friction; ``data`` gets the links' angles.
    """
    rng = place.rng(seed, 1)
    dt = model.opt.timestep
    knees = np.array([real.knee_1_nm, real.knee_2_nm])
    waves = 2.0 * real.gear_ratio
    servos = slice(place.first_control // 2, place.first_control // 2 + 6)
    arm = RealArm(
        elastic=True,
        stiffness=gear_stiffness(real).T,
        knees=knees.T,
        bends=gear_twists(real, knees).T,
        lost_torque=lost_torque(real),
        rise=real.lost_motion_rise_rad,
        inertia=real.rotor_kg_m2,
        waves=waves,
        error=gear_errors(real, rng),
        viscous=real.viscous_nm_s_rad,
        coulomb=real.coulomb_nm,
        driving=real.coulomb_driving,
        driven=real.coulomb_driven,
        cold=real.cold_friction,
        warming=real.warming_s,
        kp=-model.actuator_biasprm[servos, 1],
        kv=-model.actuator_biasprm[servos, 2],
        limit=model.actuator_forcerange[servos, 1],
        lag=1.0 - math.exp(-dt / real.servo_lag_s) if real.servo_lag_s else 1.0,
        on_link=real.servo_side == "link",
        link_rate=2.0 * math.pi * real.link_servo_hz * dt,
        encoder=real.encoder_rad,
        missed_steps=math.ceil(real.missed_s / dt),
        missed_mean=real.missed_every_s / dt,
        missed_next=-math.ceil(real.missed_s / dt),
        dice=int(rng.integers(1, 2**31)),
        set_point=q_start,
        angle=q_start,
        first=place.first,
        first_control=place.first_control,
        host=host,
    )
    # Links are left to the engine.
    model.dof_armature[place.joints] = model.dof_frictionloss[place.joints] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    _hang_links(arm, model, data, real, q_start, place)
    arm.coupling = _coupling(arm, model, data, real, dt)
    return arm


def _hang_links(
    arm: RealArm,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    real: RealArmConfig,
    q_start: Array,
    place: ArmPlace,
) -> None:
    """Rest under the weight, with the encoders that count at ``q_start``: write the links' angles or the
    motors'."""
    for _ in range(4):
        hanging = gear_twists(real, weights(model, data.qpos[None, place.joints], place))[0]
        for j, angle in enumerate(arm.angle):
            # Compiling it would take longer.
            turned, arm.ratio[j] = with_error.py_func(angle, arm.error[j], arm.waves, angle)
            arm.twist[j] = turned - data.qpos[place.first + j]
        if arm.on_link:
            arm.angle += hanging - arm.twist
        else:
            data.qpos[place.joints] += arm.twist - hanging
    arm.twist, arm.correction = hanging, arm.angle - q_start


def gear_errors(real: RealArmConfig, rng: np.random.Generator) -> Array:
    """Factors of sine and cosine of the gears' error and of twice its angle, shape (6, 4) [rad], phases
    drawn."""
    phases = rng.uniform(0.0, 2.0 * np.pi, (6, 2))
    share = real.second_harmonic * rng.uniform(0.0, 1.0, 6)
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    wave = np.sin(angle + phases[:, :1]) + share[:, None] * np.sin(2.0 * angle + phases[:, 1:])
    size = np.array(real.gear_error_rad) / np.ptp(wave, axis=1)
    first, second = size * np.array([np.cos(phases[:, 0]), np.sin(phases[:, 0])]), size * share
    return np.column_stack([*first, second * np.cos(phases[:, 1]), second * np.sin(phases[:, 1])])


def joint_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Inertia of all joints where they stand, shape (nv, nv) [kg m^2]."""
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return inertia


def _coupling(
    arm: RealArm, model: mujoco.MjModel, data: mujoco.MjData, real: RealArmConfig, dt: float
) -> Array:
    """Damping of the gears in a step (6,) [N m s/rad]: their own, or as much as keeps a light joint stable.

    Without damping a spring is stable in steps up to k dt^2 = 4 m. With k dt for damping it is taken at the
    step's end, stable at any; that damps a vibration the steps are too long to show.
    """
    stiffest = arm.stiffness.max(axis=1) + arm.lost_torque / arm.rise
    mujoco.mj_forward(model, data)
    alone = 1.0 / np.diag(np.linalg.inv(joint_inertia(model, data)))[arm.first : arm.first + 6]
    light = 0.25 * stiffest * dt**2 > _LIGHT * alone
    damping = np.array(real.damping_nm_s_rad)
    return np.where(light, np.maximum(damping, stiffest * dt), damping)
