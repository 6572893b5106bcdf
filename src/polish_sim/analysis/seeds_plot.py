"""The figures of one experiment over many seeds, each against what is asked of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from polish_sim.analysis.claim import Claim, bound_text
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREEN, ORANGE, new_figure, styled


@styled
def plot_seeds(records: Sequence[RunRecord], claims: Sequence[Claim]) -> Figure:
    """Draw every bounded figure of an experiment by seed; what falls short stands out."""
    experiment = records[0].scenario.experiment
    claims = [claim for claim in claims if claim.bounded]
    figure = new_figure(10.0, 1.0 + 1.7 * len(claims))
    panels = figure.subplots(len(claims), 1, sharex=True, squeeze=False)[:, 0]
    for axes, claim in zip(panels, claims, strict=True):
        _draw_claim(axes, claim, records)
    panels[-1].set_xlabel("seed")
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    name = records[0].scenario.controller.label
    figure.suptitle(f"{experiment}, {name}: {len(records)} seeds", x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    return figure


def _draw_claim(axes: Axes, claim: Claim, records: Sequence[RunRecord]) -> None:
    known = [(r.scenario.seed, r.metrics[claim.figure]) for r in records if r.metrics.get(claim.figure) is not None]
    for seed, value in known:
        axes.plot(seed, value * claim.scale, "o", ms=4.5, color=BLUE if claim.met_by(value) else ORANGE)
    for limit in (claim.low, claim.high):
        if math.isfinite(limit):
            axes.axhline(limit * claim.scale, color=GREEN, ls="--", lw=1.0)
    axes.set_ylabel(f"[{claim.unit}]")
    met = sum(claim.met_by(value) for _, value in known)
    axes.set_title(
        f"{claim.label.strip()}, asked {bound_text(claim)} {claim.unit}: met by {met} of {len(records)}", fontsize=9.0
    )
    axes.margins(y=0.25)
