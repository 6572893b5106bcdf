"""A job on one page: times, passes, and each region's removal summed over its passes (figures -> HTML)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

STYLE = (
    "body{font:15px sans-serif;margin:2em;}table{border-collapse:collapse}td,th{padding:.3em "
    ".8em;border-bottom:1px solid "
    "#ccc;text-align:right}td:first-child,th:first-child{text-align:left}td{white-space:nowrap}"
)


def job_page(title: str, figures: Mapping[str, Any]) -> str:
    """The page of a job from what job.json says."""
    f = figures
    totals = [
        ["robot, simulated", f"{f['cycle_time_s']:.1f}"],
        ["robot, planned", f"{f['planned_cycle_time_s']:.1f}"],
        ["  in contact", f"{f['contact_time_s']:.1f}"],
        ["  air, landing, lifts", f"{f['air_time_s']:.1f}"],
        ["operator: clamping, turning, changing", f"{f['operator_s']:.1f}"],
        ["whole", f"{f['whole_s']:.1f}"],
    ]
    passes = [
        [
            p["folder"],
            p["tool"],
            p["grit"] or "-",
            f"{p['cycle_time_s']:.1f}",
            f"{p['planned_cycle_time_s']:.1f}",
            f"{p['contact_time_s']:.1f}",
            f"{p['abrasive_path_m']:.0f}",
            f"{100.0 * p['abrasive_left']:.0f}",
            f"{100.0 * (p['removal_cv'] or 0.0):.1f}",
            p["protective_stop"] or "",
        ]
        for p in f["passes"]
    ]
    regions = [
        [
            r["region"],
            f"{r['exposure_mean_n_m']:.4g}",
            f"{100.0 * (r['removal_cv'] or 0.0):.1f}",
            f"{100.0 * (r['removal_cv_inside'] or 0.0):.1f}",
        ]
        for r in f["regions"]
    ]
    heads = [
        "pass",
        "tool",
        "grit",
        "time, s",
        "planned, s",
        "contact, s",
        "abrasive path, m",
        "abrasive left, %",
        "removal std, %",
        "stopped",
    ]
    sums = ["region, all passes", "pressure x way, N/m", "std / mean, %", "a pad's radius inside, %"]
    return (
        f'<!doctype html><meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
        f"<h1>{escape(title)}</h1><p>{1e4 * f['area_per_hour_m2']:.0f} cm² an hour, {f['parts']} part(s)</p>"
        f"{_table(['time', 's'], totals)}<h2>Passes</h2>{_table(heads, passes)}"
        f"<h2>Removal</h2>{_table(sums, regions)}\n"
    ).replace(">nan<", ">-<")


def _table(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    top = "".join(f"<th>{escape(str(head))}</th>" for head in heads)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"
