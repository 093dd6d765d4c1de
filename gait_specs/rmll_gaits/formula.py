"""Guards: propositional formulas over the foot contacts, ``FL & BR & !(FR | BL)``.

A formula over four feet is no more than the set of contact labels for which it is true, so that
is what parsing returns. A foot's name reads "this foot is in contact".
"""

import re
from contextlib import suppress

from lark import Lark, Token, Transformer
from lark.exceptions import UnexpectedInput, UnexpectedToken

from rmll_common.errors import InputError
from rmll_gaits.label import NUM_LABELS
from rmll_gaits.pose import BITS, PAPER_FEET

MAX_LENGTH = 500
"""Characters; it bounds the nesting as well, which the parser handles without recursion"""


class FormulaError(InputError):
    """A formula that does not parse: what is wrong, and in which column (from 1)."""

    def __init__(self, problem: str, column: int) -> None:
        super().__init__(f"formula, column {column}: {problem}")
        self.problem = problem
        self.column = column


def parse(text: str) -> frozenset[int]:
    """Labels for which the formula is true; FormulaError when it is none."""
    if len(text) > MAX_LENGTH:
        raise FormulaError(f"{len(text)} characters, at most {MAX_LENGTH} allowed", 1)
    try:
        return _PARSER.parse(text)  # type: ignore[return-value]  # the transformer's result
    except UnexpectedInput as error:
        raise _explain(text, error) from None


class _TruthTable(Transformer[Token, frozenset[int]]):
    """Evaluates while parsing: every part of a formula becomes its set of labels."""

    def foot(self, children: list[Token]) -> frozenset[int]:
        return frozenset(label for label in _ALL if label & BITS[children[0]])

    def constant(self, children: list[Token]) -> frozenset[int]:
        return _ALL if children[0] == "true" else frozenset()

    def opposite(self, children: list[frozenset[int]]) -> frozenset[int]:
        return _ALL - children[0]

    def both(self, children: list[frozenset[int]]) -> frozenset[int]:
        return children[0] & children[1]

    def either(self, children: list[frozenset[int]]) -> frozenset[int]:
        return children[0] | children[1]


def _explain(text: str, error: UnexpectedInput) -> FormulaError:
    """What stands where parsing stopped, and everything that could have stood there instead."""
    again = _PARSER.parse_interactive(text)
    with suppress(UnexpectedInput):
        again.exhaust_lexer()
    accepted = again.accepts()
    expected = ", ".join(words for terminal, words in _WORDS.items() if terminal in accepted)
    ended = isinstance(error, UnexpectedToken) and error.token.type == "$END"
    position = len(text) if ended else error.pos_in_stream or 0
    word = re.match(r"\w+|\S", text[position:])
    found = repr(word.group()) if word else "the end"
    return FormulaError(f"found {found}, expected {expected}", position + 1)


_ALL = frozenset(range(NUM_LABELS))
_WORDS = {
    "FOOT": f"a foot ({' '.join(PAPER_FEET)})",
    "CONSTANT": "true or false",
    "_NOT": "'!'",
    "_OPEN": "'('",
    "_CLOSE": "')'",
    # Where one operator fits so does the other, but the parser's look-ahead may drop '&'.
    "_OR": "'&' or '|'",
    "$END": "the end",
}
_PARSER = Lark.open_from_package(
    "rmll_gaits", "formula.lark", parser="lalr", transformer=_TruthTable()
)
