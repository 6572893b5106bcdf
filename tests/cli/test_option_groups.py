"""A command that takes groups of options is, to Typer and to a caller, one that takes the options themselves."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import Annotated

import pytest

from polish_sim.cli.option_groups import takes_groups


@dataclass(frozen=True)
class Colours:
    paper: Annotated[str, "colour"] = "white"
    ink: Annotated[str, "colour"] = "black"


@takes_groups
def letter(text: str, *, colours: Colours, copies: int = 1) -> str:
    """Write a letter."""
    return f"{text}, {colours.ink} on {colours.paper}, {copies} times"


def test_its_signature_lists_the_options_of_a_group_where_the_group_stands() -> None:
    parameters = inspect.signature(letter).parameters
    assert list(parameters) == ["text", "paper", "ink", "copies"]
    assert parameters["ink"].annotation == Annotated[str, "colour"]
    assert (letter.__name__, letter.__doc__) == ("letter", "Write a letter.")


def test_options_reach_the_command_in_their_group_and_keep_their_defaults_otherwise() -> None:
    assert letter(text="Dear", ink="blue", paper="white", copies=2) == "Dear, blue on white, 2 times"
    assert letter(text="Dear") == "Dear, black on white, 1 times"


def test_an_option_no_group_has_is_refused() -> None:
    with pytest.raises(TypeError, match="stamp"):
        letter(text="Dear", stamp="red")
