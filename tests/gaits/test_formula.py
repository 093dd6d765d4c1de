import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_gaits.formula import MAX_LENGTH, FormulaError, parse
from rmll_gaits.label import FEET

ALIASES = {"BR": "RR", "BL": "RL"}
TRUTH = {"true": True, "false": False}
SPELLINGS = {"&": ["&", " & ", " and "], "|": ["|", "  | ", " or "], "!": ["!", "! ", "not "]}
BINDING = {"|": 0, "&": 1, "!": 2}

leaves = st.sampled_from([*FEET, *ALIASES, *TRUTH])
trees = st.recursive(
    leaves,
    lambda trees: (
        st.tuples(st.just("!"), trees) | st.tuples(st.sampled_from(["&", "|"]), trees, trees)
    ),
    max_leaves=15,
)


def holds(tree, label):
    """Truth of a tree, straight from its definition."""
    match tree:
        case ("!", inner):
            return not holds(inner, label)
        case ("&", left, right):
            return holds(left, label) and holds(right, label)
        case ("|", left, right):
            return holds(left, label) or holds(right, label)
    return TRUTH[tree] if tree in TRUTH else label >> FEET.index(ALIASES.get(tree, tree)) & 1


def write(tree, draw, outer=0):
    """A tree as text with a random spelling and no more parentheses than are needed."""
    if isinstance(tree, str):
        return tree
    operator, *parts = tree
    binding = BINDING[operator]
    sign = draw(st.sampled_from(SPELLINGS[operator]))
    texts = [write(part, draw, binding) for part in parts]
    text = sign.join(texts) if len(texts) == 2 else sign + texts[0]
    return f"({text})" if binding < outer or draw(st.booleans()) else text


@given(tree=trees, data=st.data())
def test_a_formula_is_true_exactly_for_its_labels(tree, data):
    text = write(tree, data.draw)
    if len(text) <= MAX_LENGTH:
        assert parse(text) == {label for label in range(16) if holds(tree, label)}


@pytest.mark.fuzz
@given(st.text() | st.text(alphabet="FLRB&|!() andortefls"))
def test_any_text_parses_or_is_refused_in_one_line(text):
    try:
        assert parse(text) <= set(range(16))
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("text", "column", "problem"),
    [
        ("", 1, "found the end, expected a foot (FL FR BL BR), true or false, '!', '('"),
        ("FL & ", 6, "found the end, expected a foot (FL FR BL BR), true or false, '!', '('"),
        ("FL & FX", 6, "found 'FX', expected a foot (FL FR BL BR), true or false, '!', '('"),
        ("FL FR", 4, "found 'FR', expected '&' or '|', the end"),
        ("(FL", 4, "found the end, expected ')', '&' or '|'"),
        ("FL)", 3, "found ')', expected '&' or '|', the end"),
        ("notFL", 1, "found 'notFL', expected a foot (FL FR BL BR), true or false, '!', '('"),
    ],
)
def test_errors_say_where_what_and_what_instead(text, column, problem):
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert (caught.value.column, caught.value.problem) == (column, problem)


def test_the_longest_formula_may_nest_as_deeply_as_it_fits():
    brackets = (MAX_LENGTH - 2) // 2
    assert parse("(" * brackets + "FL" + ")" * brackets) == parse("FL")
    with pytest.raises(FormulaError, match="at most"):
        parse("!" * MAX_LENGTH + "FL")
