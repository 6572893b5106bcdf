"""The scorecard: a fixed battery of cases, run on all cores, as tables and one figure."""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.scoring.battery import BATTERY, Case, Entry, choose_cases
    from polish_sim.scoring.figures import BATTERY_ASKED, REACH, REACH_CASES, judge
    from polish_sim.scoring.score import (
        Score,
        Task,
        asked_for,
        check_entries,
        list_tasks,
        measure_row,
        measured,
        run_score,
        user_entry,
    )
    from polish_sim.scoring.summary import (
        ablation_table,
        ablations,
        about_score,
        breaking,
        markdown,
        overview,
        score_notes,
        score_tables,
        summarize,
        verdict_table,
        worst_case,
    )
else:
    __getattr__ = names_on_use(__name__)
