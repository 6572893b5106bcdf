"""Help of a command with many options, grouped; plain text, because rich would make every --help wait."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

REST = "Options"


class PanelledCommand(TyperCommand):
    """A command whose help lists its options under the panels they were declared with, and calls arguments by
    name."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Write what stands behind the command: options, then each argument."""
        return ["[OPTIONS]", *(_shown(p) for p in self.get_params(ctx) if p.param_type_name == "argument")]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then each panel in the order of its first option; options without one come
        last."""
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        rest: list[tuple[str, str]] = []
        for parameter in self.get_params(ctx):
            if parameter.param_type_name == "argument":
                panels["Arguments"].append((_shown(parameter), getattr(parameter, "help", "")))
                continue
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            panel = getattr(parameter, "rich_help_panel", None)
            (rest if panel is None else panels.setdefault(panel, [])).append(record)
        for title, records in [*panels.items(), (REST, rest)]:
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def _shown(argument: Any) -> str:
    """An argument as a user writes it: PART, RUN..., [KIND]."""
    name = argument.metavar + ("" if argument.nargs == 1 else "...")
    return name if argument.required else f"[{name}]"
