"""Hand guiding with what the controller believes gone wrong: `python -m benchmarks.hand_guiding` prints the
table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.table import words
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import override

GRIP = {"turn_stiffness_nm_rad": 30.0, "turn_damping_nm_s_rad": 10.0}
POINT: Mapping[str, float] = {}


class Study(NamedTuple):
    """A hand and what differs from the defaults of ``guide``."""

    name: str
    hand: Mapping[str, float]
    guide: Mapping[str, Any]


STUDIES = (
    Study("matched, hand that lets the tool turn", POINT, {}),
    Study("matched, hand that holds the tool", GRIP, {}),
    Study("inertia 20% over-estimated (alpha 0.96)", GRIP, {"inertia_share": 0.96}),
    Study("all masses 20% over-estimated", GRIP, {"mass_scale": 1.2}),
    Study("  without the tare", GRIP, {"mass_scale": 1.2, "tare": 0.0}),
    Study("all masses 20% under-estimated", GRIP, {"mass_scale": 0.8}),
    Study("friction 20% over-estimated", GRIP, {"friction_scale": 1.2}),
    Study("friction 20% under-estimated", GRIP, {"friction_scale": 0.8}),
    Study("1 kg at the tool, missing from the payload setting", GRIP, {"payload_kg": 1.0}),
    Study("  without the tare", GRIP, {"payload_kg": 1.0, "tare": 0.0}),
    *(
        Study(f"low-pass {hz} Hz, hand that lets it turn", POINT, {"acceleration_filter_hz": hz})
        for hz in (10.0, 20.0, 30.0, 50.0)
    ),
)
MODES = ("classical", "inertia", "assist")


def main() -> None:
    """Print the studies as a Markdown table."""
    head = " | ".join(f"{mode}, fast {d}" for mode in MODES for d in "xy")
    print(f"| | {head} | drift of assist, 60 s | stopped by |\n|{'---|' * (len(MODES) * 2 + 3)}")
    for study in STUDIES:
        print("| " + " | ".join([study.name, *_cells(study)]) + " |", flush=True)


def _cells(study: Study) -> Iterator[str]:
    base, stops, drifts = override(default_scenario("teach"), ["robot.arm=ideal"]), [], []
    for mode in MODES:
        for direction in "xy":
            guide = replace(base.guide, mode=mode, direction=direction, duration_s=0.6, **study.guide)
            run = run_experiment(replace(base, guide=guide, hand=replace(base.hand, **study.hand)))
            peak, rms = run.figures["hand_force_peak_n"], run.figures["hand_force_rms_n"]
            yield "-" if np.isnan(peak) else f"{peak:.1f} / {rms:.1f} N"
            if mode == "assist":
                drifts.append(np.degrees(run.figures["drift_rad"]))
                stops.append(run.stop_reason)
    yield (
        ", ".join(
            "-" if stop or np.isnan(drift) else f"{drift:.3g}"
            for drift, stop in zip(drifts, stops, strict=True)
        )
        + " deg"
    )
    yield (
        "; ".join(f"{d}: {stop.split(': ', 1)[1]}" for d, stop in zip("xy", stops, strict=True) if stop)
        or "-"
    )


if __name__ == "__main__":
    words(__doc__)
    main()
