"""URScript's grammar: from a text to a tree with lines and columns (package ``lark``, extra ``serve``)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from polish_sim.errors import InputError, needed

LONGEST_PROGRAM = 2_000_000  #: Characters
DEEPEST = 80  #: Brackets within brackets

GRAMMAR = r"""
start: _NL? _statements?
_statements: _statement (_NL _statement)* _NL?
_statement: routine | assign | call_alone | while | if | return | word | handle
block: _NL? _statements?

routine: KIND NAME "(" [parameter ("," parameter)*] ")" ":" block "end"
parameter: NAME ["=" _expr]
while: "while" _expr ":" block "end"
if: "if" _expr ":" block ("elif" _expr ":" block)* ("else" ":" block)? "end"
assign: [SCOPE] _postfix "=" _expr
call_alone: _postfix
return: "return" [_expr]
word: WORD
handle: HANDLE _expr

_expr: _either
_either: _all | either
either: _either (OR | XOR) _all
_all: _negated | all
all: _all AND _negated
_negated: negated | _compared
negated: "not" _negated
_compared: _sum | compared
compared: _compared COMPARE _sum
_sum: _term | sum
sum: _sum (PLUS | MINUS) _term
_term: _signed | term
term: _term TIMES _signed
_signed: _postfix | signed
signed: (PLUS | MINUS) _signed
_postfix: _atom | index | call | run
index: _postfix "[" _expr ("," _expr)* "]"
call: NAME "(" [_argument ("," _argument)*] ")"
run: "run" NAME "(" [_argument ("," _argument)*] ")"
_argument: named | _expr
named: NAME "=" _expr
_atom: NUMBER | STRING | TRUTH | NAME | "(" _expr ")" | list
list: "[" [_expr ("," _expr)*] "]"

KIND.2: /(def|thread|sec)\b/
SCOPE.2: /(global|local)\b/
WORD.2: /(break|continue|halt|pause|enter_critical|exit_critical)\b/
HANDLE.2: /(kill|join)\b/
TRUTH.2: /(True|False)\b/
OR: "or"
XOR: "xor"
AND: "and"
PLUS: "+"
MINUS: "-"
TIMES: "*" | "/" | "%"
COMPARE: "==" | "!=" | "<=" | ">=" | "<" | ">"
NAME: /[A-Za-z_][A-Za-z_0-9]*/
NUMBER: /0x[0-9a-fA-F]{1,8}|(\d+\.\d*|\.\d+|\d+)([eE][+-]?\d+)?/
STRING: /"[^"\n]*"|'[^'\n]*'/
_NL: /\n/
%ignore /[ \t\r\f]+/
%ignore /#[^\n]*/
"""


class ScriptError(InputError):
    """A programme that cannot be run, or failed: says line and column, from 1."""

    def __init__(self, line: int, column: int, text: str, wire: str = "") -> None:
        """``wire``: what a robot says of it."""
        super().__init__(f"line {line}, column {column}: {text}")
        self.line = line
        self.column = column
        self.text = text
        self.wire = wire or text

    def __reduce__(self) -> tuple[type[ScriptError], tuple[Any, ...]]:
        """For another process."""
        return ScriptError, (self.line, self.column, self.text, self.wire)


class _Lines:
    """Ends of lines count where a statement may end: not in brackets, not after an operator."""

    always_accept = ("_NL", "SCOPE")
    OPEN_ENDED = frozenset(("OR", "XOR", "AND", "PLUS", "MINUS", "TIMES", "COMPARE", "EQUAL", "NOT", "_NL"))

    def process(self, stream: Iterator[Any]) -> Iterator[Any]:
        depth = 0
        before = ""
        for token in stream:
            if token in ("(", "["):
                depth += 1
                if depth > DEEPEST:
                    raise ScriptError(
                        token.line, token.column, f"more than {DEEPEST} brackets within brackets"
                    )
            elif token in (")", "]"):
                depth = max(depth - 1, 0)
            elif token.type == "_NL" and (depth or before in self.OPEN_ENDED):
                continue
            elif token.type == "SCOPE" and before not in ("_NL", ""):
                # a statement may begin on another's last line
                yield type(token).new_borrow_pos("_NL", "\n", token)
            before = token.type
            yield token


@lru_cache(1)
def _grammar() -> Any:
    lark = needed("lark", "URScript needs the package lark", "serve")
    return lark.Lark(
        GRAMMAR, parser="lalr", postlex=_Lines(), propagate_positions=True, maybe_placeholders=False
    )


def parse(text: str) -> Any:
    """The tree of a programme. Raises ScriptError."""
    if len(text) > LONGEST_PROGRAM:
        raise ScriptError(1, 1, f"the programme is longer than {LONGEST_PROGRAM} characters")
    grammar = _grammar()
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken

    try:
        return grammar.parse(text)
    except UnexpectedToken as error:
        ends = {"$END": "the end of the text, 'end' is missing", "_NL": "the end of the line"}
        found = ends.get(error.token.type, f"'{error.token[:40]}'")
        raise ScriptError(max(error.line, 1), max(error.column, 1), f"unexpected {found}") from None
    except UnexpectedCharacters as error:
        raise ScriptError(error.line, error.column, f"unexpected {error.char!r}") from None
