import pytest

from rmll_common.errors import InputError
from rmll_gaits.compile import compile_gait
from rmll_gaits.lint import lint
from rmll_gaits.load import library_names, load_spec
from rmll_gaits.spec import read_spec

HEAD = "gait: g\ncommands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}\n"


def findings(body, head=HEAD):
    return [
        (f.level, f.message.removeprefix("g.yaml")) for f in lint(read_spec(head + body, "g.yaml"))
    ]


@pytest.mark.parametrize("gait", ["trot", "walk"])
def test_gaits_that_can_stand_in_every_pose_are_clean(gait):
    assert lint(load_spec(gait)) == []


@pytest.mark.parametrize("gait", ["pace", "bound", "three_one", "half_bound"])
def test_the_other_gaits_of_the_paper_are_sound_but_demanding(gait):
    found = lint(load_spec(gait))
    assert found
    assert all(level == "warning" and "only briefly" in message for level, message in found)


def test_a_robot_can_jump_whatever_the_library_asks_for():
    found = [finding for gait in library_names() for finding in lint(load_spec(gait))]
    assert not [f.message for f in found if f.level == "error" or " lasts " in f.message]


def test_all_errors_are_reported_at_once():
    body = (
        "states:\n"
        "  q0:\n"
        "    - {when: FL, to: q1}\n"
        "    - {when: FL & FR, to: q0}\n"
        "    - {when: BL & !BL, to: q0}\n"
        "  q1:\n"
        "    - {when: BL, reject: true}\n"
        "  q2:\n"
        "    - {when: BL, to: q0}\n"
    )
    found = findings(body)
    assert {level for level, _ in found} == {"error"}
    assert [message.partition(": ")[2] for _, message in found] == [
        "state q0: 'BL & !BL' is true for no contact",
        "state q0: contact FL FR opens two edges, 'FL' to q1 and 'FL & FR' to q0",
        "state q2 cannot be reached from q0",
        "state q1 is a dead end, no edge leads on",
    ]


@pytest.mark.parametrize(
    ("poses", "words"),
    [
        ("none, FL FR BL BR", ["pose none: all feet in the air"]),
        ("FL BR, FR", ["pose FR: a single foot down"]),
        ("FL BL, FR BR", ["only the left feet down", "only the right feet down"]),
        ("FL FR, BL BR", ["only the front feet down", "only the back feet down"]),
        ("FL BR, FL FR BL", []),
    ],
)
def test_poses_that_tip_over_are_named(poses, words):
    found = findings(f"cycle: [{poses}]")
    assert len(found) == len(words)
    assert all(word in message for word, (_, message) in zip(words, found, strict=True))


def test_an_edge_with_one_sound_contact_is_no_reason_to_warn():
    assert findings("states:\n  a: [{when: FL & !FR, to: b}]\n  b: [{when: FR & !FL, to: a}]") == []


def test_a_bonus_for_standing_still_is_found():
    found = findings("states:\n  a: [{when: FL & BR, to: b}]\n  b: [{when: FR & BL, to: a}]")
    assert found == [
        ("warning", ": a robot that stands still in FL FR BL BR earns bonus after bonus")
    ]


def test_a_gait_that_ignores_the_frequency_is_found():
    found = findings("cycle: [{feet: FL BR, dwell: 0}, {feet: FR BL, dwell: 0}]")
    assert any("(through q0, q1) goes round at any c_f" in message for _, message in found)
    assert not findings("cycle: [{feet: FL BR, dwell: 0}, FR BL]", HEAD.replace("6,", "10,"))


START_REJECTED = """\
states:
  q0:
    - {when: FL & !FR & !BL & !BR, to: q1}
    - {when: BR, reject: true%s}
  q1:
    - {when: FR & !FL & !BL & !BR, to: q0}
    - {when: BR, reject: true}
"""


def test_an_edge_that_rejects_the_robot_as_it_starts_is_an_error():
    (level, message), *more = findings(START_REJECTED % "")
    assert (level, more) == ("error", [])
    assert message.startswith(":6:14: state q0: 'BR' rejects the robot as it starts")
    assert "'grace: 20'" in message
    with pytest.raises(InputError, match="rejects the robot as it starts"):
        compile_gait(read_spec(HEAD + START_REJECTED % "", "g.yaml"))
    assert all(level == "warning" for level, _ in findings(START_REJECTED % ", grace: 1"))
    # three feet down are no start
    elsewhere = START_REJECTED.replace("{when: BR,", "{when: BR & !FL,") % ""
    assert all(level == "warning" for level, _ in findings(elsewhere))


def flights(poses, frequency="[6, 10]"):
    found = findings(f"cycle: [{poses}]", HEAD.replace("[6, 12]", frequency))
    return [message for _, message in found if " lasts " in message]


def test_a_dwell_that_makes_a_flight_impossible_is_explained():
    (found,) = flights("FL BR, {feet: none, dwell: 0.5}, FR BL, {feet: none, dwell: 0.5}")
    assert found == (
        ": at frequency 6 pose none lasts 0.12 s of each 0.36 s, so each foot in contact bears"
        " 1.5 times the robot's weight; the dwell at the pose after it, FR BL, says how long (1),"
        " its own (0.5) how long FL BR lasts; write a smaller dwell at FR BL"
    )
    # the same dwells at the poses that they were meant for
    assert not flights("{feet: FL BR, dwell: 0.5}, none, {feet: FR BL, dwell: 0.5}, none")


@pytest.mark.parametrize(
    ("poses", "frequency", "words"),
    [
        ("FL FR BL BR, none", "[6, 16]", None),
        ("FL FR BL BR, none", "[6, 20]", "lasts 0.40 s, a hop of 0.20 m; "),
        ("{feet: FL FR BL BR, dwell: 2}, none", "[6, 10]", "at frequency 10 pose none lasts 0.40"),
        ("FL, none, FR, none", "[6, 10]", "each foot in contact bears 2.0 times"),
        ("FL, FR", "[6, 10]", None),
        ("none, none", "[6, 10]", "no foot bears the robot's weight"),
    ],
)
def test_a_flight_ends_by_gravity_and_has_to_be_jumped(poses, frequency, words):
    found = flights(poses, frequency)
    assert [words in message for message in found] == ([True] if words else [])


def test_waiting_with_a_foot_down_is_no_flight():
    states = 'states:\n  a: [{when: "!FL & !FR", to: b}]\n  b: [{when: FL & FR, to: a, dwell: 9}]'
    assert not [message for _, message in findings(states) if " lasts " in message]


def test_periods_that_no_dog_keeps_are_found():
    head = HEAD.replace("[6, 12]", "[2, 60]")
    assert [message for _, message in findings("cycle: [FL BR, FR BL]", head)] == [
        ": at frequency 2 a cycle takes 0.08 s, plausible are 0.2 to 2 s",
        ": at frequency 60 a cycle takes 2.40 s, plausible are 0.2 to 2 s",
    ]
