"""YAML files as structs, and back."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from rmll_common import typed_yaml
from rmll_common.errors import InputError


class Leaf(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    size: Annotated[float, Meta(ge=0)]
    name: str = ""
    kind: Literal["a", "b"] = "a"
    pair: tuple[float, int] = (0.0, 0)

    def __post_init__(self) -> None:
        if self.name == "bad":
            raise ValueError("bad is no name")


@dataclass(frozen=True)
class Tree:
    leaves: dict[str, Leaf] = field(default_factory=dict)
    first: Leaf = field(default_factory=lambda: Leaf(1.0))
    limit: float | None = None
    how: Literal["auto"] | bool = "auto"


def test_what_a_file_leaves_out_is_as_before():
    base = Tree({"x": Leaf(2.0)}, Leaf(3.0, "n"), 4.0, True)
    assert typed_yaml.parse("", "t.yaml", base) == base
    found = typed_yaml.parse("first: {size: 1e-3}\nhow: off", "t.yaml", base)
    assert found == Tree({"x": Leaf(2.0)}, Leaf(0.001, "n"), 4.0, False)
    # entries of a dictionary have no names of ours: the file's stand in for all
    found = typed_yaml.parse("leaves: {y: {size: 1}}\nlimit: null", "t.yaml", base)
    assert found == Tree({"y": Leaf(1.0)}, Leaf(3.0, "n"), None, True)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("leaves: {x: {size: 1}, y: {size: -1}}", "1:34: found '-1', expected a number >= 0.0"),
        ("leaves: {x: {name: n}}", "1:13: key 'size' is missing"),
        ("leaves: {x: {size: 1, sise: 1}}", "1:23: unknown key 'sise', expected one of size, "),
        ("leaves: [1]", "1:9: found a list, expected a mapping"),
        ("first: {pair: [1, 1.5]}", "1:19: found '1.5', expected a whole number"),
        ("first: {pair: [1]}", "1:15: found a list, expected a list of length 2, got 1"),
        ("first: {name: 7}", "1:15: found '7', expected a text in quotes"),
        ("first: {name: bad}", "1:8: bad is no name"),
        ("first: {kind: c}", "1:15: found 'c', expected one of a, b"),
        ("limit: much", "1:8: found 'much', expected a number or null"),
        ("how: so", "1:6: found 'so', expected one of auto, true, false"),
        ("limit: true", "1:8: found 'true', expected a number or null"),
    ],
)
def test_a_mistake_is_told_with_its_place(text, complaint):
    with pytest.raises(InputError) as refused:
        typed_yaml.parse(text, "t.yaml", Tree())
    assert str(refused.value).startswith(f"t.yaml:{complaint}")


texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=8) | st.sampled_from(
    ["1e3", "010", "0o10", "1:0", "on", "~", "", "2001-12-14", "0x1f", "1_0", ".nan", "<<", "-"]
)
numbers = st.floats(allow_nan=False, allow_infinity=False)
whole = st.integers(-(2**63), 2**63 - 1)
leaves = st.builds(Leaf, numbers.map(abs), texts, st.sampled_from("ab"), st.tuples(numbers, whole))
names = st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=5)


@given(
    st.builds(
        Tree,
        st.dictionaries(names | st.sampled_from(["1e3", "no", "010"]), leaves, max_size=3),
        leaves,
        st.none() | numbers,
        st.booleans() | st.just("auto"),
    ),
    st.sampled_from([None, True, False]),
)
def test_what_is_written_is_read_back(tree, flow):
    text = typed_yaml.dump(msgspec.to_builtins(tree), default_flow_style=flow)
    found = typed_yaml.parse(text, "t.yaml", Tree())
    assert found == tree
    assert repr(found) == repr(tree) or "-0.0" in repr(tree)
