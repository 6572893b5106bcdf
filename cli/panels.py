"""Help of a command with many options, grouped; plain text, because rich would make every --help wait."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

REST = "Options"


class PanelledCommand(TyperCommand):
    """A command whose help lists its options under the panels they were declared with."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then each panel in the order of its first option; options without one come last."""
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        rest: list[tuple[str, str]] = []
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            if parameter.param_type_name == "argument":
                panels["Arguments"].append(record)
                continue
            panel = getattr(parameter, "rich_help_panel", None)
            (rest if panel is None else panels.setdefault(panel, [])).append(record)
        for title, records in [*panels.items(), (REST, rest)]:
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)
