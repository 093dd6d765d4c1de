"""What YAML files may say, and how plain scalars are read."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rmll_common import yaml_document, yaml_scalar
from rmll_common.errors import InputError


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001), ("1e3", 1000), ("-2.5E+2", -250), (".5", 0.5), ("1.", 1.0), ("+7", 7),
        ("0", 0), ("-0.0", 0.0), ("0x100", 256), ("010.5", 10.5), ("3e6", 3_000_000),
        ("true", True), ("On", True), ("no", False), ("~", None), ("", None), ("null", None),
        ("trot", "trot"), ("y", "y"), ("1.2.3", "1.2.3"), ("2001-12-14", "2001-12-14"),
        ("0x", "0x"), ("e3", "e3"), ("127.0.0.1:8007", "127.0.0.1:8007"), ("ff01::1", "ff01::1"),
        ("_1", "_1"), ("1:99", "1:99"), ("٣", "٣"), ("9" * 41, "9" * 41), ("=", "="), ("<<", "<<"),
    ],
)  # fmt: skip
def test_a_plain_scalar_is_what_yaml_1_2_reads(text, value):
    found = yaml_scalar.read(text)
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("010", 'write 8 or 10, or "010" for a text'),
        ("0o10", 'write 8, or "0o10" for a text'),
        ("-0o17", "write -15,"),
        ("08", "write 8,"),
        ("007", "write 7,"),
        ("1:0", 'write 60, or "1:0" for a text'),
        ("-1:30:0", "write -5400,"),
        ("1:30.5", "write 90.5,"),
        ("1_000", "write 1000,"),
        ("1_0.5", "write 10.5,"),
        ("0x_ff", "write 0xff,"),
        ("0b101", "write 5,"),
        (".inf", "expected a finite number"),
        ("-.Inf", "expected a finite number"),
        (".NaN", "expected a finite number"),
        ("1e999", "expected a finite number"),
    ],
)
def test_a_number_that_is_read_in_two_ways_is_refused_with_what_to_write(text, advice):
    with pytest.raises(ValueError, match=r"^found ") as refused:
        yaml_scalar.read(text)
    assert advice in str(refused.value)


def yaml_1_1(text: str) -> object:
    """What PyYAML has for a plain scalar; None for a number that it makes and cannot read."""
    loader = yaml.SafeLoader("")
    tag = loader.resolve(yaml.ScalarNode, text, (True, False))
    try:
        return loader.construct_object(yaml.ScalarNode(tag, text))
    except ValueError:
        return None


@given(st.from_regex(r"[-+]?[0-9xob:._eE]{1,8}", fullmatch=True))
def test_no_number_is_read_in_silence_as_another_one(text):
    """Where PyYAML, which has YAML 1.1, finds a number, we find the same or refuse it."""
    try:
        ours, theirs = yaml_scalar.read(text), yaml_1_1(text)
    except ValueError:
        return
    if isinstance(theirs, int | float):
        assert ours == theirs
    elif isinstance(ours, int | float):
        # in YAML 1.1 an exponent wants a dot and a sign, and a dot a digit before it
        assert "e" in text.lower() or text[1:2] == "."


scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
)
keys = st.text(st.characters(categories=["L", "N", "Z"]), min_size=1, max_size=5).filter(str.strip)
plain_values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3)
)


def is_the_same(left, right) -> bool:
    """Equal, and True is not 1."""
    if isinstance(left, bool) or isinstance(right, bool):
        return left is right
    if isinstance(left, dict) and isinstance(right, dict):
        return left.keys() == right.keys() and all(is_the_same(left[k], right[k]) for k in left)
    if isinstance(left, list) and isinstance(right, list):
        return len(left) == len(right) and all(map(is_the_same, left, right))
    return left == right


def differs_between_versions(value) -> bool:
    """A text that stock PyYAML writes without quotes, and YAML 1.2 has as a number."""
    if isinstance(value, dict):
        return any(map(differs_between_versions, [*value, *value.values()]))
    if isinstance(value, list):
        return any(map(differs_between_versions, value))
    try:
        return isinstance(value, str) and not isinstance(yaml_scalar.read(value), str)
    except ValueError:
        return True


@given(plain_values.filter(lambda value: not differs_between_versions(value)))
def test_what_stock_yaml_writes_is_read_back(plain):
    text = yaml.dump(plain, Dumper=Unaliased)
    assert is_the_same(yaml_document.read(text, "x.yaml").plain(), plain)


class Unaliased(yaml.SafeDumper):
    def ignore_aliases(self, data):
        return True


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a: {b: [1, {c: 1, 'c': 2}]}", "x.yaml:1:19: key 'c' is given twice"),
        ("a: &a 1\nb: *a", "x.yaml:1:4: anchors and aliases are not read, write the value out"),
        ("b: *a", "x.yaml:1:4: anchors and aliases are not read, write the value out"),
        ("a: !!float 3", "x.yaml:1:4: the tag '!!float' is not read; quote a text that begins"),
        ("a: !mine {}", "x.yaml:1:4: the tag '!mine' is not read"),
        ("a: 1\n---\nb: 2", "x.yaml:2:1: not YAML: expected a single document"),
        ("? [a]\n: 3", "x.yaml:1:3: found a list, expected a text"),
        ("?", "x.yaml:1:2: found nothing, expected a text"),
        ("- " * 40, "x.yaml:1:65: nested too deeply"),
        ("a:\tb: c", "x.yaml:1:"),
        ("#" * 100_001, "x.yaml: 100001 characters, at most 100000 allowed"),
        (f"{'k' * 90}: 1\n{'k' * 90}: 1", f"x.yaml:2:1: key '{'k' * 40}...' is given twice"),
    ],
)
def test_what_a_file_cannot_say(text, complaint):
    with pytest.raises(InputError) as refused:
        yaml_document.read(text, "x.yaml").plain()
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"a: \xff")
    for bad, complaint in (
        (path, "not a text in UTF-8"),
        (tmp_path, "cannot be read: Is a directory"),
        (tmp_path / "none.yaml", "cannot be read: No such file"),
    ):
        with pytest.raises(InputError, match=complaint) as refused:
            yaml_document.read_text(bad)
        assert str(refused.value).startswith(f"{bad}: ")
    path.write_bytes("\ufeffa: ü\r\n".encode())
    assert yaml_document.read(yaml_document.read_text(path), "x.yaml").plain() == {"a": "ü"}


@pytest.mark.fuzz
@given(st.text() | st.lists(st.sampled_from([*"{}[]:,-?!&*|>'\"%#@`\n \t01eo.x_a~<=", ": ", "- "]))
       .map("".join))  # fmt: skip
def test_any_text_is_read_or_refused_in_one_line(text):
    try:
        yaml_document.read(text, "x.yaml").plain()
    except InputError as error:
        assert "\n" not in str(error)
        assert str(error).startswith("x.yaml:")
