"""The settings file."""

from contextlib import suppress

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rmll_gaits.errors import InputError
from rmll_onboard.settings import Settings, as_yaml, load_settings


@pytest.fixture
def refusal(tmp_path):
    def load(text: str) -> str:
        path = tmp_path / "settings.yaml"
        path.write_text(text)
        with pytest.raises(InputError) as refused:
            load_settings(path)
        return str(refused.value)

    return load


def test_printed_defaults_are_a_settings_file(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text(as_yaml(Settings()))
    assert load_settings(path) == load_settings(None) == Settings()


def test_what_is_left_out_keeps_its_default(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text("safety: {stale_ms: 30}")
    assert load_settings(path).safety.stale_ms == 30
    assert load_settings(path).feet == Settings().feet
    path.write_text("")
    assert load_settings(path) == Settings()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("saftey: {}", "unknown 'saftey'; known: link, feet, steering, safety, motion"),
        ("safety: {role_limit: 1}", "safety: unknown 'role_limit'; known: roll_limit, pitch"),
        ("safety: {roll_limit: 3}", "<= 1.5 - at `$.safety.roll_limit`"),
        ("safety: {roll_limit: .nan}", "roll_limit"),
        ("safety: {roll_limit: wide}", "got `str`"),
        ("feet: {touching: 0.2, clear: 0.3}", "clear is 0.3, expected at most touching, 0.2"),
        ("link: {local_port: 70000}", "<= 65535"),
        ("motion: {rise: 0}", ">= 0.1"),
        ("safety: 3", "expected `object`, got `int`"),
        ("[1, 2]", "got `array`"),
        ("a: [", "cannot be read"),
        ("!!python/object/apply:os.getcwd []", "cannot be read"),
    ],
)
def test_wrong_files_are_refused(refusal, text, words):
    assert words.lower() in refusal(text).lower()


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        load_settings(tmp_path / "nowhere.yaml")


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)
names = st.sampled_from(
    ["link", "feet", "steering", "safety", "motion", "robot_address", "touching", "stale_ms"]
)


@pytest.mark.fuzz
@given(st.dictionaries(names, st.dictionaries(names, values) | values))
def test_any_yaml_gives_settings_or_one_error(tmp_path_factory, plain):
    path = tmp_path_factory.mktemp("settings") / "settings.yaml"
    path.write_text(yaml.safe_dump(plain))
    with suppress(InputError):
        assert isinstance(load_settings(path), Settings)
