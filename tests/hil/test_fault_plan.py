"""The fault plan: reading it, and what it does to robot and network."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmll_common import typed_yaml
from rmll_common.errors import InputError
from rmll_hil.faults.fault_rows import ROWS
from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.fault_plan import KINDS, Network, Push, load_plan, parse_plan, read_plan
from rmll_hil.robot.lossy_channel import LossyChannel
from rmll_hil.robot.sensors import QUIET
from rmll_onboard.protocol import a1_remote
from rmll_onboard.protocol.a1_packets import check_state, decode_state, encode_command
from rmll_onboard.protocol.a1_remote import Button
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MODE_SERVO, MotorCommand
from rmll_robots import A1

BRAKE = encode_command(MotorCommand())


def test_a_plan_is_read(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text("- {fault: network, loss: 0.2}\n- {fault: push, at: 3, force: [0, 50, 0]}\n")
    assert load_plan(path, A1) == (Network(loss=0.2), Push(at=3, force=(0, 50, 0)))
    path.write_text("")
    assert load_plan(path, A1) == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- {fault: earthquake}", ":1:11: unknown fault 'earthquake', expected one of network, "),
        ("- {loss: 1}", ":1:3: key 'fault' is missing, one of network, frozen"),
        ("- {fault: push}", ":1:3: key 'force' is missing"),
        ("- {fault: push, force: [1, 2]}", ":1:24: found a list, expected a list of length 3"),
        ("- {fault: push, force: [1, 2, x]}", ":1:31: found 'x', expected a number"),
        ("- {fault: network}\n- {fault: network, loss: 2}", ":2:26: found '2', expected a number"),
        ("- {fault: network, los: 0.2}", ":1:20: unknown key 'los', expected one of fault, at"),
        ("- {fault: network, at: 1, at: 2}", ":1:27: key 'at' is given twice"),
        ("- {fault: network, jitter_ms: .nan}", ":1:31: found .nan, expected a finite number"),
        ("- {fault: network, at: -1}", ":1:24: found '-1', expected a number >= 0.0"),
        ("- {fault: network, at: 1:30}", ":1:24: found 1:30, which readers of YAML take"),
        ("- {fault: nan_joint, joint: FR}", ":1:29: found 'FR', expected one of FR_hip_joint"),
        ("- {fault: dead_foot, foot: LF}", ":1:28: found 'LF', expected one of FR, FL, RR, RL"),
        ("- {fault: remote, buttons: [Z]}", ":1:28: found 'Z', expected one of"),
        ("fault: push", ":1:1: found a mapping, expected a list"),
        ("- {fault: frozen}\n" * 1001, ":1:1: found a list of 1001, expected 0 to 1000"),
        ("- !!python/object/apply:os.getcwd []", ":1:3: the tag '!!python/object/apply"),
        ("- [", ":1:4: not YAML"),
        ("- " * 500, ":1:65: nested too deeply"),
        ("#" * 200_000, ": 200000 characters, at most 100000 allowed"),
    ],
)
def test_a_wrong_plan_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load_plan(path, A1)
    assert words in str(refused.value)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


values = st.none() | st.booleans() | st.floats() | st.text(max_size=3) | st.integers()
names = st.sampled_from(
    ["fault", "at", "seconds", "joint", "loss", "force", "buttons", "foot", "mode", "direction"]
)
entries = st.dictionaries(names, values | st.lists(values, max_size=3)) | values


@pytest.mark.fuzz
@settings(deadline=None)
@given(st.lists(entries, max_size=3), st.sampled_from(list(KINDS)))
def test_any_yaml_is_a_plan_or_one_error(plain: list, kind: str) -> None:
    for entry in plain:
        if isinstance(entry, dict):
            entry["fault"] = kind
    with suppress(InputError):
        read_plan(typed_yaml.dump(plain), "plan", A1)


def test_the_rows_of_the_table_are_plans() -> None:
    for row in ROWS:
        assert len(parse_plan(row.plan, A1)) == len(row.plan)
    assert len({row.name for row in ROWS}) == len(ROWS)
    # every kind of fault is provoked
    assert {entry["fault"] for row in ROWS for entry in row.plan} == set(KINDS)


def through(count: int = 4000, seed: int = 0, **network: float) -> list[tuple[int, bytes]]:
    """What comes out of a way into which a numbered datagram goes every 2 ms, and when."""
    way = LossyChannel((Network(**network),), "from_robot", np.random.default_rng(seed))
    came = []
    for number in range(count):
        way.send(number.to_bytes(100, "big"), 2 * number)
        came += [(2 * number, datagram) for datagram, _ in way.arrived(2 * number)]
    return came


def order(came: list[tuple[int, bytes]]) -> np.ndarray:
    return np.array([int.from_bytes(datagram, "big") for _, datagram in came])


def test_a_sound_network_passes_everything_on_at_once() -> None:
    came = through()
    assert [now for now, _ in came] == [2 * number for number in order(came)]
    assert len(came) == 4000


def test_loss_and_duplicates_have_their_share() -> None:
    assert len(through(loss=0.2)) == pytest.approx(3200, rel=0.05)
    assert len(through(duplicates=0.2)) == pytest.approx(4800, rel=0.05)
    assert through(loss=1.0) == []


def test_jitter_and_reordering_overtake() -> None:
    assert (np.diff(order(through(jitter_ms=5))) < 0).mean() > 0.1
    held = np.diff(order(through(reorder=0.1))) < 0
    assert 0.05 < held.mean() < 0.15
    late = through(delay_ms=10)
    assert (np.diff(order(late)) == 1).all()
    assert late[0] == (10, bytes(100))


def test_corruption_damages_its_share() -> None:
    came = through(corrupt=0.3)
    damaged = [datagram for now, datagram in came if datagram != (now // 2).to_bytes(100, "big")]
    assert len(damaged) == pytest.approx(1200, rel=0.1)
    assert any(len(datagram) < 100 for datagram in damaged)


def test_a_way_is_its_seed() -> None:
    odds = {"loss": 0.1, "duplicates": 0.1, "jitter_ms": 5, "corrupt": 0.1}
    assert through(seed=1, **odds) == through(seed=1, **odds) != through(seed=2, **odds)


def robot(*plan: dict) -> Emulator:
    return Emulator(noise=QUIET, plan=parse_plan(list(plan), A1))


def pass_time(emulator: Emulator, milliseconds: int) -> bytes:
    for _ in range(0, milliseconds, 10):
        emulator.receive(BRAKE)
        emulator.advance(10, 0)
    return emulator.state_datagram()


def test_sensors_lie_while_the_fault_lasts() -> None:
    emulator = robot(
        {"fault": "wrong_joint", "joint": "FL_hip_joint", "q": 1.0, "tau": -5, "at": 0.1},
        {"fault": "hot_joint", "joint": "RR_calf_joint", "rate": 100, "seconds": 0.3},
        {"fault": "wrong_gyro", "rate": [0, 0, 3e38]},
        {"fault": "flipped_imu", "at": 0.1},
        {"fault": "dead_foot", "foot": "RL", "reads": -7},
    )
    before, after = (decode_state(pass_time(emulator, 50)) for _ in range(2))
    joint = A1.joint_names.index("FL_hip_joint")
    assert after.q[joint] - before.q[joint] == pytest.approx(1.0, abs=0.01)
    assert after.tau[joint] - before.tau[joint] == pytest.approx(-5, abs=0.5)
    assert after.temperature[8] == 35 + 10
    assert before.gyro[2] == pytest.approx(3e38)
    assert abs(before.rpy[0]) < 0.2
    assert abs(after.rpy[0]) > 3
    assert after.foot_force[3] == -7
    assert decode_state(pass_time(emulator, 300)).temperature[8] == 35


def test_a_frozen_board_repeats_itself() -> None:
    emulator = robot({"fault": "frozen", "at": 0.1, "seconds": 0.1})
    states = [pass_time(emulator, 50) for _ in range(5)]
    assert states[1] == states[0]
    assert states[4] != states[2] == states[0]
    running = robot({"fault": "frozen", "at": 0.1, "clock_runs": True})
    first, second, third = (pass_time(running, 50) for _ in range(3))
    assert first[10:719] == second[10:719] == third[10:719]
    assert [decode_state(state).tick for state in (first, second, third)] == [50, 100, 150]


def test_a_joint_that_is_no_number_is_a_whole_datagram() -> None:
    datagram = pass_time(robot({"fault": "nan_joint", "joint": "FR_hip_joint"}), 10)
    check_state(datagram)
    with pytest.raises(BadPacket) as refused:
        decode_state(datagram)
    assert refused.value.reason is Reason.NOT_FINITE


def test_the_body_is_pushed() -> None:
    emulator = robot({"fault": "push", "seconds": 0.1, "force": [0, 0, 1000]})
    pass_time(emulator, 90)
    # 1000 N on 12.45 kg, less its weight, for 0.09 s
    up = emulator.truth()["velocity"][-1][2]
    assert up == pytest.approx((1000 / 12.45 - 9.81) * 0.09, rel=0.2)
    pass_time(emulator, 30)
    assert not emulator.world.data.xfrc_applied.any()


def test_the_body_is_kicked() -> None:
    emulator = robot({"fault": "kick", "at": 0.1, "velocity": [0.0, 0.5]})
    pass_time(emulator, 110)
    sideways = emulator.truth()["velocity"][:, 1]
    assert np.abs(sideways[:20]).max() < 0.05
    assert 0.2 < sideways[-1] <= 0.55


def test_another_commander_moves_the_legs() -> None:
    emulator = robot({"fault": "other_commander", "pose": "stand"})
    state = decode_state(pass_time(emulator, 1000))
    assert (state.mode == MODE_SERVO).mean() > 0.5
    assert np.abs(state.q - A1.stand_pose).max() < 0.4


def test_a_braked_joint_says_so() -> None:
    emulator = robot({"fault": "braked_joint", "joint": "FR_hip_joint", "mode": 8})
    assert decode_state(pass_time(emulator, 50)).mode[0] == 8


def test_the_remote_is_pressed_released_and_lost() -> None:
    emulator = robot(
        {"fault": "remote", "seconds": 0.1, "buttons": ["L2", "B"], "ly": -0.5},
        {"fault": "remote_lost", "at": 0.2},
    )
    held, released, lost = (decode_state(pass_time(emulator, 80)).remote for _ in range(3))
    assert a1_remote.decode(held).buttons == Button.L2 | Button.B
    assert a1_remote.decode(held).ly == -0.5
    assert a1_remote.decode(released) == a1_remote.Remote()
    assert any(released)
    assert not any(lost)
