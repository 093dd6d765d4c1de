"""The settings file."""

from contextlib import suppress

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_onboard.settings.can_settings import Bus, Can
from rmll_onboard.settings.runtime_settings import (
    LinkSettings,
    RuntimeSettings,
    Safety,
    as_yaml,
    load_settings,
)


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
    path.write_text(as_yaml(RuntimeSettings()))
    assert load_settings(path) == load_settings(None) == RuntimeSettings()


@pytest.mark.parametrize("odd", ["1e3", "010", "1:0", "on", "~", "a: b # c", "ü\n'", "2001-12-14"])
def test_printed_settings_read_back_whatever_is_in_them(tmp_path, odd):
    bus = Bus(odd, odd)
    can = Can(buses=Can().buses | {odd: bus}, reply_timeout_ms=1e2)
    settings = RuntimeSettings(
        LinkSettings(robot_address=odd), safety=Safety(joint_margin=1e-05), can=can
    )
    path = tmp_path / "settings.yaml"
    path.write_text(as_yaml(settings))
    assert load_settings(path) == settings


def test_what_is_left_out_keeps_its_default(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text("safety: {stale_ms: 30}")
    assert load_settings(path).safety.stale_ms == 30
    assert load_settings(path).feet == RuntimeSettings().feet
    path.write_text("")
    assert load_settings(path) == RuntimeSettings()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("saftey: {}", "1:1: unknown key 'saftey', expected one of link, feet, steering, safety"),
        ("safety: {role_limit: 1}", "1:10: unknown key 'role_limit', expected one of roll_limit"),
        ("safety: {roll_limit: 3}", "1:22: found '3', expected a number <= 1.5"),
        ("safety: {roll_limit: .nan}", "1:22: found .nan, expected a finite number"),
        ("safety: {roll_limit: wide}", "1:22: found 'wide', expected a number"),
        ("safety: {roll_limit: '1'}", "1:22: found the text '1', expected a number"),
        ("feet: {touching: 0.2, clear: 0.3}", "1:7: clear is 0.3, expected at most touching, 0.2"),
        ("link: {local_port: 70000}", "1:20: found '70000', expected a whole number <= 65535"),
        ("link: {robot_address: 8007}", "1:23: found '8007', expected a text in quotes"),
        ("link: {kind: tcp}", "1:14: found 'tcp', expected one of udp, can"),
        ("motion: {rise: 0}", "1:16: found '0', expected a number >= 0.1"),
        ("safety: 3", "1:9: found '3', expected a mapping"),
        ("[1, 2]", "1:1: found a list, expected a mapping"),
        ("a: [", "1:5: not YAML: while parsing a flow node"),
        ("!!python/object/apply:os.getcwd []", "1:1: the tag '!!python/object/apply:os.getcwd'"),
        ("safety: {roll_limit: 0.5}\nlink: {}\nsafety: {}", "3:1: key 'safety' is given twice"),
        ("safety: {stale_ms: 1:0}", "1:20: found 1:0, which readers of YAML take differently"),
        ("realtime: {core: 010}", "1:18: found 010, which readers of YAML take differently"),
        ("can:\n  actuators:\n    a: {id: 1}\n    a: {id: 2}", "4:5: key 'a' is given twice"),
        ("can:\n  buses:\n    a: {interface: x, speed: 3}", "3:23: unknown key 'speed'"),
        ("can: {models: {a: {reply: morse}}}", "1:27: found 'morse', expected one of plain, "),
        ("can: {buses: {}}", "1:14: found a mapping, expected a mapping of length >= 1"),
    ],
)
def test_wrong_files_are_refused_with_their_place(refusal, text, words):
    assert f"settings.yaml:{words}" in refusal(text)


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
        assert isinstance(load_settings(path), RuntimeSettings)


def test_an_old_name_is_read_and_told_with_the_new_one(tmp_path, capsys):
    path = tmp_path / "settings.yaml"
    path.write_text("safety: {obedience_ms: 250}\nrealtime: {rehearse_us: 0}\n")
    settings = load_settings(path)
    assert (settings.safety.actuator_ms, settings.realtime.cache_warmup_us) == (250, 0)
    assert capsys.readouterr().err.splitlines() == [
        f"{path}:1:24: 'obedience_ms' is called 'actuator_ms' now",
        f"{path}:2:25: 'rehearse_us' is called 'cache_warmup_us' now",
    ]


def test_an_old_name_beside_the_new_one_is_refused(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text("safety: {obedience_ms: 250, actuator_ms: 100}\n")
    with pytest.raises(InputError, match=r":1:24: 'obedience_ms' is the old name of"):
        load_settings(path)
