import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_common.yaml_document import MAX_CHARACTERS
from rmll_gaits.compile import compile_gait
from rmll_gaits.spec import read_spec

HEAD = "gait: g\ncommands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}\n"
CYCLE = "cycle: [FL, FR]"
EDGE = HEAD + "states:\n  q0:\n    - "


def refusal(text):
    with pytest.raises(InputError) as caught:
        compile_gait(read_spec(text, "g.yaml"))
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "g.yaml: the file is empty"),
        ("trot", "g.yaml:1:1: found 'trot', expected a mapping"),
        ("gait: g", "g.yaml:1:1: key 'commands' is missing"),
        (HEAD, "g.yaml:1:1: found neither of 'states' and 'cycle', expected one"),
        (
            HEAD + "cycle: [FL, FR]\nstates: {q0: []}",
            "g.yaml:1:1: found both of 'states' and 'cycle', expected one",
        ),
        (HEAD + "gait: h\ncycle: [FL, FR]", "g.yaml:3:1: key 'gait' is given twice"),
        (
            HEAD + "cycel: [FL, FR]",
            "g.yaml:3:1: unknown key 'cycel', expected one of"
            " gait, description, commands, start, states, cycle",
        ),
        (HEAD + "cycle: [FL]", "g.yaml:3:8: found a list of 1, expected 2 to 63"),
        (
            HEAD + "cycle: [FL, FX]",
            "g.yaml:3:13: found 'FX' in a pose, expected feet (FL FR BL BR) or 'none'",
        ),
        (HEAD + "cycle: [FL, BL RL]", "g.yaml:3:13: foot RL twice in a pose"),
        (
            HEAD.replace("[6, 12]", "[12, 6]") + CYCLE,
            "g.yaml:2:49: the range runs down from 12 to 6",
        ),
        (
            HEAD.replace("[6, 12]", "[0, 6]") + CYCLE,
            "g.yaml:2:50: found '0', expected a number from 1 to",
        ),
        (HEAD.replace("gait: g", "gait: My Gait") + CYCLE, "'My Gait' is no name"),
        (HEAD + "states: {q_r: []}", "state q_r is made by 'reject: true'"),
        (EDGE + "{when: FL, to: q1}", "g.yaml:5:22: no state 'q1', expected one of q0"),
        (EDGE + "{when: FL}", "g.yaml:5:7: expected 'to: STATE' or 'reject: true'"),
        (EDGE + "{when: FL, to: q0, dwell: -1}", "g.yaml:5:33: found '-1', expected a number"),
        (EDGE + "{when: FL, to: q0, dwell: .nan}", "found .nan, expected a finite number"),
        (EDGE + "{when: FL, to: q0, grace: 3}", "g.yaml:5:33: 'grace' goes with 'reject: true'"),
        (EDGE + "{when: FL, reject: true, grace: 2.5}", "found '2.5', expected a whole number"),
        (EDGE + "{when: FL, reject: maybe}", "found 'maybe', expected true"),
        (EDGE + "{when: FL & FX, to: q0}", "g.yaml:5:19: found 'FX', expected a foot"),
        (EDGE + "{when: 'FL & FX', to: q0}", "g.yaml:5:20: found 'FX', expected a foot"),
        (EDGE + "{when: !FL & BR, to: q0}", "a formula that begins with '!' needs quotes"),
        (EDGE + "{when: FL & !FL, to: q0}", "g.yaml:5:14: state q0: 'FL & !FL' is true for no"),
        (
            EDGE + "{when: FL, to: q0}\n    - {when: FR & BL, to: q0}",
            "g.yaml:6:14: state q0: contact FL FR BL opens two edges,"
            " 'FL' to q0 and 'FR & BL' to q0",
        ),
        (EDGE + "{when: FL, to: q0}\n  q1: []", "g.yaml:6:7: state q1 cannot be reached from q0"),
        (EDGE + "{when: FL, reject: true}", "g.yaml:5:5: state q0 is a dead end"),
        ("[" * MAX_CHARACTERS, "nested too deeply"),
        ("#" * (MAX_CHARACTERS + 1), "g.yaml: 100001 characters, at most 100000 allowed"),
        ("\0", "not YAML"),
        ('gait: "\\UFFFFFFFF"', "not YAML"),
        (HEAD + CYCLE + '\ndescription: "\\e[2J"', "expected printable characters"),
        ("&a [*a]", "g.yaml:1:1: anchors and aliases are not read"),
        (EDGE + "{when: FL, to: q0, dwell: 010}", "g.yaml:5:33: found 010, which readers"),
        (EDGE + "{when: FL, to: q0, dwell: '1'}", "g.yaml:5:33: found the text '1', expected a"),
        (EDGE + "{when: FL, to: q0, dwell: yes}", "g.yaml:5:33: found 'yes', expected a number"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_with_its_place(text, message):
    assert message in refusal(text)


def test_both_forms_of_a_gait_compile_to_the_same_table():
    short = HEAD + "cycle: [FL BR, {feet: FR RL, dwell: 0.5}]"
    full = HEAD + (
        "states:\n"
        "  q0:\n    - {when: FL & BR & !(FR | BL), to: q1}\n"
        "  q1:\n    - {when: FR and BL and not FL and not BR, to: q0, dwell: 0.5}\n"
    )
    tables = [compile_gait(read_spec(text, "g.yaml")).to_dict() for text in (short, full)]
    assert tables[0] == tables[1]


WORDS = (
    "gait commands cycle states start when to reject edges hold q0 FL BR 1 true"
    " ! & &a *a | [ ] { } : , - --- % ? \" '"
)
words = st.sampled_from([*WORDS.split(), "\n"])


@pytest.mark.fuzz
@given(st.text() | st.lists(words, max_size=60).map(" ".join))
def test_any_text_is_a_gait_or_an_input_error(text):
    for source in (text, HEAD + text, EDGE + text):
        try:
            compile_gait(read_spec(source, "g.yaml"))
        except InputError as error:
            assert "\n" not in str(error)


values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.sampled_from(["FL", "q0", "x"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
        st.sampled_from(["when", "to", "dwell", "reject", "grace", "edges", "hold", "feet", "q0"]),
        inner, max_size=4,
    ),
)  # fmt: skip


@pytest.mark.fuzz
@given(st.sampled_from(["cycle", "states", "start", "description"]), values)
def test_any_yaml_value_anywhere_is_a_gait_or_an_input_error(key, value):
    try:
        compile_gait(read_spec(HEAD + yaml.safe_dump({key: value}), "g.yaml"))
    except InputError as error:
        assert "\n" not in str(error)
