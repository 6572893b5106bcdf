"""From a tree of URScript to Python: functions become generators, which wait where they yield.

A name of the programme gets a letter in front (``g_`` global, ``l_`` local, ``f_`` function, ``b_``
built-in), so that nothing of Python can be reached; every statement remembers its line and column.
"""

from __future__ import annotations

import inspect
import marshal
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from math import inf
from typing import Any, NamedTuple

from polish_sim.errors import did_you_mean
from polish_sim.ur.script.built_ins import BuiltIns
from polish_sim.ur.script.parse import ScriptError, parse
from polish_sim.ur.script.values import LONGEST_LIST

FILE = "<urscript>"
LOOK_EVERY = 20  #: Statements between looks at the time that is left


class Program(NamedTuple):
    """A programme ready to run."""

    name: str
    secondary: bool  #: Runs beside the present one and may not wait
    code: bytes  #: Of Python, as `marshal` has it: another process may have read it
    places: Mapping[int, tuple[int, int]]  #: Line and column of URScript by Python's line


@dataclass
class _Routine:
    """A function or thread, and the variables it has for itself."""

    tree: Any
    body: Any
    signature: inspect.Signature = inspect.Signature()
    own: set[str] = field(default_factory=set)


BUILT_IN_WORDS = {"enter_critical": "pass", "exit_critical": "pass", "halt": "raise Halt"}
OPERATIONS = {"+": "add", "-": "sub", "*": "mul", "%": "mod", "xor": "xor"}
"""Operators that are functions of `values`; the others are Python's own."""


class _Translator:
    """Translates one programme; ``built_ins``: what a name outside the programme calls."""

    def __init__(self, built_ins: Mapping[str, Callable[..., Any]]) -> None:
        self.built_ins = built_ins
        self.routines: dict[str, _Routine] = {}
        # variables of the programme, and the line from which on functions see them
        self.shared: dict[str, int] = {}
        self.lines: list[str] = []
        self.places: dict[int, tuple[int, int]] = {}
        self.here: _Routine | None = None

    def translate(self, text: str) -> Program:
        tree = parse(text)
        name = ""
        body = tree
        secondary = False
        first = tree.children[0] if tree.children else None
        if first is not None and first.data == "routine":
            kind, named = first.children[:2]
            for extra in tree.children[1:]:
                called = extra.children[0] if extra.data == "call_alone" else None
                if getattr(called, "children", None) != [named]:  # many call what they send
                    raise _refusal(extra, "one programme at a time: this stands behind its 'end'")
            name = str(named)
            body = first.children[-1]
            secondary = kind == "sec"
        main = _Routine(body, body)
        self._collect(main)
        for routine in self.routines.values():
            self._find_own(routine)
        self.here = main
        self._write_routine(main, "main")
        for word, routine in self.routines.items():
            self.here = routine
            self._write_routine(routine, f"f_{word}")
        try:
            with warnings.catch_warnings(action="ignore"):
                code = compile("\n".join(self.lines) + "\n", FILE, "exec")
        except SyntaxError as error:
            line, column = self.places.get(error.lineno or 0, (1, 1))
            raise ScriptError(line, column, error.msg) from None
        return Program(name, secondary, marshal.dumps(code), self.places)

    # Who owns which variable.

    def _collect(self, main: _Routine) -> None:
        for tree in main.body.iter_subtrees_topdown():
            if tree.data == "routine":
                kind, name, *parameters, body = tree.children
                if kind == "sec":
                    raise _refusal(tree, "'sec' stands alone")
                if name in self.routines:
                    raise _refusal(tree, f"a second '{name}'")
                self.routines[str(name)] = _Routine(tree, body, _signature(tree, parameters))
            elif tree.data == "assign" and tree.children[0] == "global":
                self.shared[_target(tree)] = 0
        for tree in _assignments(main.body):
            self.shared.setdefault(_target(tree), tree.meta.line)

    def _find_own(self, routine: _Routine) -> None:
        routine.own.update(word.removeprefix("l_") for word in routine.signature.parameters)
        for tree in _assignments(routine.body):
            name = _target(tree)
            if tree.children[0] == "local" or self.shared.get(name, 1 << 30) > routine.tree.meta.line:
                routine.own.add(name)

    # Text of Python.

    def _write(self, depth: int, text: str, tree: Any) -> None:
        self.lines.append(" " * depth + text)
        self.places[len(self.lines)] = _place(tree)

    def _write_routine(self, routine: _Routine, name: str) -> None:
        parameters = [
            word if taken.default is taken.empty else f"{word}={self._expression(taken.default)}"
            for word, taken in routine.signature.parameters.items()
        ]
        self._write(0, f"def {name}({', '.join(parameters)}):", routine.tree)
        shared = sorted(set(map(_target, _assignments(routine.body))) - routine.own)
        if shared:
            self._write(1, "global " + ", ".join(f"g_{word}" for word in shared), routine.tree)
        self._write(1, f"spend({self._cost(routine.body)})", routine.tree)
        self._write_block(routine.body, 1)
        self._write(1, "if 0: yield", routine.tree)

    def _cost(self, body: Any) -> int:
        return 1 + sum(len(tree.children) for tree in _statements(body, whole=True))

    def _write_block(self, block: Any, depth: int) -> None:
        self.lines.append(" " * depth + "pass")
        for number, tree in enumerate(block.children, 1):
            if number % LOOK_EVERY == 0:
                self._write(depth, "spend(0)", tree)
            if tree.data != "routine":
                getattr(self, f"_write_{tree.data}")(tree, depth)

    def _write_assign(self, tree: Any, depth: int) -> None:
        *_, place, value = tree.children
        name = self._variable(_target(tree))
        text = self._expression(value)
        if _kind(place) == "index":
            inside, *indices = place.children
            if _kind(inside) == "index":
                indices = [*inside.children[1:], *indices]
            text = f"replaced({', '.join([name, text, *map(self._expression, indices)])})"
        self._write(depth, f"{name} = {text}", tree)

    def _write_call_alone(self, tree: Any, depth: int) -> None:
        if _kind(tree.children[0]) not in ("call", "run"):
            raise _refusal(tree, "a value alone does nothing: a call, an assignment or a keyword is expected")
        self._write(depth, self._expression(tree.children[0]), tree)

    def _write_while(self, tree: Any, depth: int) -> None:
        condition, block = tree.children
        self._write(depth, f"while {self._expression(condition)}:", tree)
        self._write(depth + 1, f"spend({self._cost(block)})", tree)
        self._write_block(block, depth + 1)

    def _write_if(self, tree: Any, depth: int) -> None:
        parts = list(tree.children)
        word = "if"
        while len(parts) > 1:
            condition, block, *parts = parts
            self._write(depth, f"{word} {self._expression(condition)}:", block if block.children else tree)
            self._write_block(block, depth + 1)
            word = "elif"
        for block in parts:
            self._write(depth, "else:", tree)
            self._write_block(block, depth + 1)

    def _write_return(self, tree: Any, depth: int) -> None:
        self._write(depth, "return " + "".join(map(self._expression, tree.children)), tree)

    def _write_word(self, tree: Any, depth: int) -> None:
        word = str(tree.children[0])
        if word == "pause":
            raise _refusal(tree, "'pause' is not served: use a blocking popup")
        self._write(depth, BUILT_IN_WORDS.get(word, word), tree)

    def _write_handle(self, tree: Any, depth: int) -> None:
        word, thread = tree.children
        text = self._expression(thread)
        self._write(depth, f"yield from join({text})" if word == "join" else f"kill({text})", tree)

    def _variable(self, name: str) -> str:
        assert self.here is not None
        return f"l_{name}" if name in self.here.own else f"g_{name}"

    def _expression(self, tree: Any) -> str:
        if kind := _kind(tree):
            return getattr(self, f"_{kind}")(tree)
        if tree.type == "NAME":
            if tree not in self.here.own and tree not in self.shared:  # type: ignore[union-attr]
                raise _refusal(
                    tree, f"'{tree}' is never given a value.{did_you_mean(str(tree), self.shared)}"
                )
            return self._variable(str(tree))
        if tree.type == "NUMBER":
            return repr(_number(tree))
        return repr(str(tree)[1:-1]) if tree.type == "STRING" else str(tree)

    def _operation(self, tree: Any) -> str:
        left, sign, right = tree.children
        pair = self._expression(left), self._expression(right)
        name = OPERATIONS.get(sign)
        return f"{name}({pair[0]}, {pair[1]})" if name else f"({pair[0]} {sign} {pair[1]})"

    _either = _all = _compared = _sum = _term = _operation

    def _negated(self, tree: Any) -> str:
        return f"(not {self._expression(tree.children[0])})"

    def _signed(self, tree: Any) -> str:
        return f"({tree.children[0]}{self._expression(tree.children[1])})"

    def _list(self, tree: Any) -> str:
        if len(tree.children) > LONGEST_LIST:
            raise _refusal(tree, f"a list of more than {LONGEST_LIST} elements")
        return "List(checked((" + "".join(f"{self._expression(value)}, " for value in tree.children) + ")))"

    def _index(self, tree: Any) -> str:
        of, *indices = tree.children
        if of == "p" and len(indices) == 6:
            return f"pose({', '.join(map(self._expression, indices))})"
        text = self._expression(of)
        for index in indices:
            if getattr(index, "type", "") == "NUMBER" and isinstance(_number(index), int):
                text = f"{text}[{_number(index)}]"
            else:
                text = f"element({text}, {self._expression(index)})"
        return text

    def _call(self, tree: Any) -> str:
        text, waits = self._called(tree)
        return f"(yield from {text})" if waits else text

    def _run(self, tree: Any) -> str:
        text, _ = self._called(tree)
        if str(tree.children[0]) not in self.routines:
            raise _refusal(tree, f"'{tree.children[0]}' is no thread of this programme")
        return f"run({text})"

    def _called(self, tree: Any) -> tuple[str, bool]:
        """The call, checked, and whether it waits."""
        word, *arguments = tree.children
        name = str(word)
        routine = self.routines.get(name)
        placed = [argument for argument in arguments if _kind(argument) != "named"]
        named = [argument.children for argument in arguments if _kind(argument) == "named"]
        if arguments[: len(placed)] != placed:
            raise _refusal(word, "named arguments stand behind the others")
        if routine is not None:
            signature, mark, prefix = routine.signature, "l_", "f_"
        elif name in self.built_ins:
            signature, mark, prefix = inspect.signature(self.built_ins[name]), "", "b_"
        else:
            text = f"unknown function '{name}'.{did_you_mean(name, {*self.built_ins, *self.routines})}"
            raise ScriptError(*_place(word), text, f"compile_error_name_not_found:{name}:")
        try:
            signature.bind(*placed, **{f"{mark}{key}": value for key, value in named})
        except TypeError:
            takes = ", ".join(key.removeprefix(mark) for key in signature.parameters)
            raise _refusal(word, f"{name} takes ({takes})") from None
        texts = [self._expression(argument) for argument in placed]
        texts += [f"{mark}{key}={self._expression(value)}" for key, value in named]
        waits = routine is not None or inspect.isgeneratorfunction(self.built_ins[name])
        return f"{prefix}{name}({', '.join(texts)})", waits


def _signature(tree: Any, parameters: list[Any]) -> inspect.Signature:
    """What a routine takes."""
    of = inspect.Parameter
    named = [parameter.children for parameter in parameters]
    try:
        return inspect.Signature([
            of(f"l_{name}", of.POSITIONAL_OR_KEYWORD, default=default[0] if default else of.empty)
            for name, *default in named
        ])  # fmt: skip
    except ValueError:
        raise _refusal(tree, "a parameter without a default behind one with, or twice") from None


def _number(token: Any) -> int | float:
    if token.startswith("0x"):
        return int(token, 16)
    number = float(token)
    if number == inf:
        raise _refusal(token, "a number too large")
    return int(token) if token.isdigit() and len(token) < 10 else number


def _statements(body: Any, whole: bool = False) -> Iterator[Any]:
    """The trees in a body, or its statements, without functions within."""
    for tree in body.children:
        if _kind(tree) not in ("", "routine"):
            yield tree
            if whole or tree.data in ("if", "while", "block"):
                yield from _statements(tree, whole)


def _assignments(body: Any) -> Iterator[Any]:
    return (tree for tree in _statements(body) if tree.data == "assign")


def _kind(tree: Any) -> str:
    """What a tree is of; empty for a word."""
    return getattr(tree, "data", "")


def _target(assign: Any) -> str:
    """The variable an assignment changes."""
    place = assign.children[-2]
    while _kind(place) == "index":
        place = place.children[0]
    if getattr(place, "type", "") != "NAME":
        raise _refusal(assign, "only a variable or an element of one can be given a value")
    return str(place)


def _place(tree: Any) -> tuple[int, int]:
    meta = getattr(tree, "meta", tree)
    return getattr(meta, "line", 1), getattr(meta, "column", 1)


def _refusal(tree: Any, text: str) -> ScriptError:
    return ScriptError(*_place(tree), text)


@lru_cache(8)
def read(text: str) -> Program | ScriptError:
    """A programme ready to run, or what is wrong with it; the last few are kept."""
    try:
        return _Translator(BuiltIns().table()).translate(text.replace("\r\n", "\n"))
    except (RecursionError, MemoryError):
        return ScriptError(1, 1, "nested too deep")
    except ScriptError as error:
        return error


def translate(text: str) -> Program:
    """A programme ready to run. Raises ScriptError."""
    found = read(text)
    if isinstance(found, ScriptError):
        raise found
    return found
