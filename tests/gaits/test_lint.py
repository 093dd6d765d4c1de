import pytest

from rmll_gaits.lint import lint
from rmll_gaits.load import load_spec
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


def test_periods_that_no_dog_keeps_are_found():
    head = HEAD.replace("[6, 12]", "[2, 60]")
    assert [message for _, message in findings("cycle: [FL BR, FR BL]", head)] == [
        ": at frequency 2 a cycle takes 0.08 s, plausible are 0.2 to 2 s",
        ": at frequency 60 a cycle takes 2.40 s, plausible are 0.2 to 2 s",
    ]
