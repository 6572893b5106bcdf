"""An identified robot written back as a MJCF: the robot's own model with other inertias and friction."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import mujoco
import numpy as np

from polish_sim.arms import FIRST
from polish_sim.arrays import Array
from polish_sim.errors import InputError
from polish_sim.identification.robot_model import ARM_JOINTS
from polish_sim.models import robot_model_path
from polish_sim.motion.serial_chain import body_of

RobotSource: TypeAlias = Path | mujoco.MjSpec | None
"""A robot's MJCF: a file, or a model not yet compiled; None: the shipped robot's file."""
BY_LOAD = "friction_by_load"  #: Name of its numbers in an identified model
ASSETS = "meshes"  #: Folder beside the model with copies of its files
_TEXTURE_FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


def write_portable(file: Path, xml: str) -> Path:
    """Write a model whose folders are absolute, as MuJoCo saves it; copies of its files go to `ASSETS` beside
    it."""
    root = ElementTree.fromstring(xml)
    compiler = root.find("compiler")
    assert compiler is not None  # MuJoCo saves one always
    folders = compiler.attrib
    taken: dict[str, Path] = {}
    for element in root.iterfind("asset/*"):
        beside = Path(folders.get("texturedir" if element.tag == "texture" else "meshdir", ""))
        for attribute in _TEXTURE_FILES:
            if attribute in element.attrib:
                source = beside / element.attrib[attribute]
                # Without a name of its own an asset has its file's.
                element.attrib.setdefault("name", source.stem)
                element.attrib[attribute] = _copied(source, file.parent / ASSETS, taken)
    for name in ("meshdir", "texturedir"):
        folders.pop(name, None)
        if taken:
            folders[name] = ASSETS
    ElementTree.indent(root)
    file.write_text(ElementTree.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    return file


def _copied(source: Path, folder: Path, taken: dict[str, Path]) -> str:
    """Copy a file under its own name, or with a number where another file has it."""
    name = source.name
    count = 1
    while taken.get(name, source) != source:
        count += 1
        name = f"{source.stem}_{count}{source.suffix}"
    if name not in taken:
        folder.mkdir(exist_ok=True)
        shutil.copyfile(source, folder / name)
        taken[name] = source
    return name


def read_robot_model(file: Path) -> mujoco.MjModel:
    """Compile a user's MJCF; InputError if it is no file, or with what the compiler said."""
    return _compiled(_read(file), file)


def identified_xml(
    joints: Sequence[str], parameters: Array, terms: Mapping[str, Array], source: RobotSource = None
) -> str:
    """A robot's complete MJCF with identified numbers; meshes are found where the source has them.

    ``parameters``: ten of each joint's own body about the joint's origin, (n, 10), physically consistent, or
    the model would not compile; ``terms``: friction and rotors as of `regressor.TERMS`, (n,) each, ``load``
    also driving and driven, (2, n), those not given stay as they are; ``source``: its MJCF, the shipped
    robot's if None.
    """
    file = source if isinstance(source, Path) else robot_model_path()
    spec = source.copy() if isinstance(source, mujoco.MjSpec) else _read(file)
    spec.modelname = f"{FIRST if source is None else spec.modelname}_identified"
    # What is read from a string has no folder of its own.
    beside = Path(spec.modelfiledir).resolve()
    spec.meshdir, spec.texturedir = str(beside / spec.meshdir), str(beside / spec.texturedir)
    for number, name in enumerate(joints):
        joint = spec.joint(name)
        _write_inertia(joint.parent, joint.pos, parameters[number])
        if "viscous" in terms:
            joint.damping[0] = terms["viscous"][number]
        if "coulomb" in terms:
            joint.frictionloss = terms["coulomb"][number]
        if "armature" in terms:
            joint.armature = terms["armature"][number]
    if "load" in terms:
        both = np.broadcast_to(terms["load"], (2, len(joints)))
        spec.add_numeric(name=BY_LOAD, data=both.ravel(), size=both.size)
    _compiled(spec, file)
    return str(spec.to_xml())


def friction_by_load(file: Path) -> Array:
    """Friction by load of an identified model's joints, driving and driven, shape (2, n); 0 where it has
    none."""
    try:
        return np.array(read_robot_model(file).numeric(BY_LOAD).data).reshape(2, -1)
    except KeyError:
        return np.zeros((2, len(ARM_JOINTS)))


def _read(file: Path) -> Any:
    if not file.is_file():
        raise InputError(f"cannot read the robot model '{file}': it is no file.")
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as error:
        raise _no_model(file, error) from None


def _compiled(spec: Any, file: Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise _no_model(file, error) from None


def _no_model(file: Path, error: ValueError) -> InputError:
    said = " ".join(str(error).split()).rstrip(".")
    return InputError(f"'{file}' is no MuJoCo model (MJCF, or URDF MuJoCo can read): {said}.")


def _write_inertia(body: mujoco.MjsBody, origin: Array, parameters: Array) -> None:
    mass = parameters[0]
    if mass <= 0.0:
        # Of several joints on one body only the last carries it.
        return
    numbers = body_of(parameters, origin)
    body.mass, body.ipos = mass, numbers[1:4]
    body.inertia, body.iquat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    body.fullinertia = numbers[[4, 6, 9, 5, 7, 8]]
    body.explicitinertial = True
