"""What the proof of a plan says, and whether it holds for a path and the settings of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from polish_sim.analysis.claim import FOLLOW_BAND_N
from polish_sim.analysis.metrics import MOST_FORCE
from polish_sim.analysis.run_record import changed_words
from polish_sim.config import Checked, FaultsConfig, PlanConfig, ProcessConfig, Scenario, SensorConfig
from polish_sim.errors import count_text, place_in_mm
from polish_sim.experiments.assembly import config_hash
from polish_sim.experiments.proof_play import ASTRAY, BAND, SHAKEN
from polish_sim.experiments.registry import default_scenario
from polish_sim.planning import PlanResult
from polish_sim.planning.part_plan import EASED, SLOWED
from polish_sim.planning.toolpath import ToolPath, stretches
from polish_sim.source_stamp import short_hash

#: What helps where a run may fail ``--check``, by what it fails by. The force may be off by a quarter and at
#: most by `FOLLOW_BAND_N`, and the arm shakes more under a larger one: where both meet there is most room.
HELPS = {
    BAND: f"a --contact-force nearer to {FOLLOW_BAND_N / (MOST_FORCE - 1.0):.3g} N helps",
    ASTRAY: "a lower --contact-force helps, and robot.compensation=tracker",
}


def proof_settings(scenario: Scenario) -> Scenario:
    """What a proof depends on besides path and pose: arm, tool, sensor, controller, force, feed, limits and
    how far off its drawing a part may be."""
    process = replace(scenario.process, changes="", learn="")
    return replace(
        scenario,
        experiment="surface",
        seed=0,
        part=replace(scenario.part, file="", fixture_file="", unit="", up="", pose=()),
        plan=PlanConfig(),
        process=process,
        faults=FaultsConfig(),
        pad=replace(scenario.pad, choice="given"),
        safety=replace(scenario.safety, proof=""),
        simulation=replace(scenario.simulation, log_rate_hz=0.0),
    )


def proof_notes(proof: Mapping[str, Any]) -> list[str]:
    """What was played, how near it came to its limits, and what was mended, for the user."""
    limits = proof["limits"]
    name = max(limits, key=lambda name: limits[name]["share"])
    share, at_m = limits[name]["share"], limits[name]["at_m"]
    notes = [
        f"proven: played in the cell with {proof['controller']} at up to {1e3 * proof['feed_m_s']:.4g} mm/s "
        f"and up to {proof['contact_force_n']:.4g} N on the arm {proof['arm']}; nearest to its limit: "
        f"{name}, {100.0 * share:.0f}% at {1e3 * at_m:.4g} mm of the path"
    ]
    for name, helps in HELPS.items():
        share = limits[name]["share"] if name in limits else 0.0
        # Other arms shake and stray by up to as much more.
        if share > 1.0 / SHAKEN:
            fails = "this fails" if share > 1.0 else "on other arms and parts this may fail"
            notes.append(f"{fails} run --check: {name}; {helps}")
    if proof.get("work_used", 0.0) > 1.0:
        notes.append(
            "the proof's time was used up: it may use its limits without a margin for other parts, and "
            "no further pad was tried"
        )
    groups: dict[tuple[str, float, str], list[Mapping[str, Any]]] = {}
    for mend in proof["mends"]:
        groups.setdefault((mend["what"], mend["share"], mend["why"].partition(":")[0]), []).append(mend)
    for (what, share, why), alike in groups.items():
        of = {SLOWED: "feed", EASED: "force"}.get(what)
        to = f"{what} to {share:.0%} of the {of}" if of else what
        length = 1e3 * sum(mend["length_m"] for mend in alike)
        more = "" if len(alike) == 1 else f" and {count_text(len(alike) - 1, 'more place')}"
        notes.append(
            f"{to}: {length:.3g} mm of the path at {place_in_mm(alike[0]['at_m'])}{more}, because {why}"
        )
    return notes


class Drift(NamedTuple):
    """How far the zero of a plan's sensor walks until it is set again, and what it may [N]."""

    time: float  #: In contact until then [s]
    most: float  #: By all of its warming up, with the rms of its random walk
    half: float  #: What half of all sensors exceed
    band: float  #: How far the force, where it is largest, may be off
    force: float  #: The largest
    strokes: bool  #: Whether to zero it before every stroke would help


def drift_of(process: ProcessConfig, sensor: SensorConfig, plan: PlanResult) -> Drift:
    """How far the sensor's zero may walk on a plan's path."""
    path = plan.path
    alone = [path.s[last] - path.s[first] for first, last in stretches(path.process)]
    strokes = len(alone) > 1 and process.tare == "start"
    share = max(alone) / sum(alone) if process.tare == "strokes" else 1.0
    time = share * plan.figures["time_in_contact_s"]
    warmed = -sensor.warm_up_force_n * math.expm1(-time / sensor.warm_up_s)
    most = warmed + sensor.force_drift_n_s * math.sqrt(time)
    force = path.largest_force(process.contact_force_n)
    band = min(FOLLOW_BAND_N, (MOST_FORCE - 1.0) * force)
    return Drift(time, most, 0.5 * warmed, band, force, strokes)


def drift_notes(process: ProcessConfig, sensor: SensorConfig, plan: PlanResult) -> list[str]:
    """Where the sensor's zero may walk further than what counts as contact, or than the force may be off."""
    drift = drift_of(process, sensor, plan)
    if drift.strokes and drift.most > process.contact_threshold_n:
        than, may = "counts as contact", "stop. --set process.tare=strokes zeroes it before every stroke"
    elif drift.most > drift.band:
        than, may = f"the {drift.band:.2g} N the force may be off", "fail --check"
    else:
        return []
    return [
        f"the sensor's zero may drift by {drift.most:.1f} N on the path, more than {than}: runs differ, and "
        f"may {may}"
    ]


def path_key(path: ToolPath) -> str:
    """What identifies a path, to a micrometre."""
    columns = (path.positions_work, path.axes_work, path.segment, path.force, path.feed)
    # Read from a file axes are made unit again: their last bits differ.
    content = b"".join(
        np.round(1e6 * column).astype(np.int64).tobytes() for column in columns if column is not None
    )
    return short_hash(content)


def why_not_proven(scenario: Checked, path: ToolPath, proof: Mapping[str, Any]) -> str:
    """Why a plan folder's ``proof`` does not hold for a path and its settings; empty if it does."""
    settings = proof_settings(scenario)
    if proof["settings"] != config_hash(settings, {}):
        words = {*changed_words(settings, proof_settings(default_scenario("surface")))}
        words ^= {*proof.get("changed", ())}
        names = sorted({word.partition("=")[0] for word in words}) or ["a file they name, or the version"]
        return f"of other settings ({', '.join(names[:3])}{', ...' * (len(names) > 3)})"
    if proof["path"] != path_key(path):
        return "of the path from its start (--from)" if scenario.plan.begin_m else "of another path"
    if scenario.part.pose != tuple(proof["pose"]):
        return "of another pose of the part"
    return "" if scenario.safety.proof in ("nominal", proof["proof"]) else f"with --proof {proof['proof']}"
