from pathlib import Path

import numpy as np
import pytest

from rmll_common.errors import Failure, InputError
from rmll_hil.robot import emulator as emulator_module
from rmll_hil.robot.emulator import TRUTH_MS, Emulator, EmulatorSettings
from rmll_hil.robot.sensors import QUIET
from rmll_onboard.protocol.a1_packets import decode_state, encode_command
from rmll_onboard.state.robot_state import MODE_BRAKE, MODE_SERVO, MotorCommand
from rmll_robots import A1

TICK_MS = 5


def hold(pose: np.ndarray) -> bytes:
    return encode_command(
        MotorCommand(
            mode=np.full(12, MODE_SERVO, np.uint8),
            q=pose,
            kp=np.full(12, A1.stand_kp),
            kd=np.full(12, A1.stand_kd),
        )
    )


def stand_up(emulator: Emulator, ticks: int = 500) -> list[bytes]:
    """Rise from the measured pose in the first two thirds; returns the states."""
    lying = decode_state(emulator.state_datagram()).q
    states = []
    for tick in range(ticks):
        share = min(1.0, 1.5 * tick / ticks)
        emulator.receive(hold((1 - share) * lying + share * A1.stand_pose))
        emulator.advance(TICK_MS, emulator.now_ms * 1_000_000)
        states.append(emulator.state_datagram())
    return states


def test_lies_still_until_commanded() -> None:
    emulator = Emulator(noise=QUIET)
    before = decode_state(emulator.state_datagram())
    emulator.advance(1000, 0)
    after = decode_state(emulator.state_datagram())
    np.testing.assert_allclose(after.q, before.q, atol=0.02)
    assert (after.mode == MODE_BRAKE).all()
    assert after.tick - before.tick == 1000
    assert emulator.truth()["position"][-1, 2] < 0.15


def test_stands_up_from_lying() -> None:
    emulator = Emulator()
    state = decode_state(stand_up(emulator)[-1])
    truth = emulator.truth()
    assert truth["position"][-1, 2] == pytest.approx(0.3, abs=0.02)
    assert truth["contact"][-1].all()
    assert not truth["grounded"][-100:].any()
    np.testing.assert_allclose(state.q, A1.stand_pose, atol=0.1)
    np.testing.assert_allclose(state.rpy[:2], 0, atol=0.05)
    np.testing.assert_allclose(state.accelerometer, [0, 0, 9.81], atol=0.7)
    assert (state.foot_force > 20).all()


def test_a_silent_commander_lets_the_robot_sink_down_damped() -> None:
    emulator = Emulator(EmulatorSettings(command_timeout_ms=50))
    stand_up(emulator)
    emulator.advance(51 + TICK_MS, 0)
    assert (decode_state(emulator.state_datagram()).mode == MODE_BRAKE).all()
    emulator.advance(3000, 0)
    truth = emulator.truth()
    assert truth["position"][-1, 2] < 0.15
    assert np.abs(truth["velocity"][-600:, 2]).max() < 1.0, "it dropped instead of sinking"


def test_bad_datagrams_are_dropped_and_counted() -> None:
    emulator = Emulator()
    good = hold(A1.stand_pose)
    flipped = bytearray(good)
    flipped[20] ^= 1
    for datagram in (b"", b"hello", good[:-1], good + b"\0", bytes(610), bytes(flipped)):
        assert not emulator.receive(datagram)
    assert emulator.receive(good)
    assert (emulator.received, emulator.rejected) == (7, 6)


def test_the_same_seed_gives_the_same_datagrams() -> None:
    first, again, other = (
        stand_up(Emulator(EmulatorSettings(seed=seed)), ticks=100) for seed in (3, 3, 4)
    )
    assert first == again
    assert first != other


def test_truth_of_a_moved_robot() -> None:
    emulator = Emulator()
    stand_up(emulator)
    # turned left by a quarter and pushed along its own nose, which is the world's y
    emulator.world.data.qpos[3:7] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    emulator.world.data.qvel[:] = 0
    emulator.world.data.qvel[1] = 0.3
    emulator.advance(TRUTH_MS, 77)
    sample = emulator.truth()[-1]
    assert sample["time_ns"] == 77
    np.testing.assert_allclose(sample["velocity"], [0.3, 0, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("flag", "complaint"),
    [
        ({"seed": -1}, "--seed -1: expected at least 0"),
        ({"friction": float("nan")}, "--friction nan: expected 0.01 to 10"),
        ({"friction": float("inf")}, "--friction inf: expected 0.01 to 10"),
        ({"action_delay_ms": -5}, "--action-delay-ms -5: expected 0 to 1000"),
        ({"command_timeout_ms": 10**9}, "--command-timeout-ms 1000000000: expected 1 to 100000"),
        ({"level": 10}, "--level 10: expected 0 to 9"),
    ],
)
def test_impossible_settings_are_refused(flag: dict, complaint: str) -> None:
    with pytest.raises(InputError, match=f"^{complaint}$"):
        Emulator(EmulatorSettings(**flag))


def test_energy_adds_up_torque_times_speed() -> None:
    emulator = Emulator()
    stand_up(emulator)
    energy = emulator.truth()["energy"]
    assert (np.diff(energy) >= 0).all()
    # raising 12.45 kg by 0.2 m costs 24 J at the least
    assert 24 < energy[-1] < 150


def test_a_base_on_the_ground_is_noticed() -> None:
    emulator = Emulator()
    emulator.world.data.qpos[2] = 0.05
    emulator.advance(2 * TRUTH_MS, 0)
    assert list(emulator.truth()["grounded"]) == [False, True]


def test_diverging_physics_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log file where it stands
    emulator = Emulator()
    emulator.world.data.qvel[0] = np.nan
    with pytest.raises(Failure, match="the physics diverged after 5 ms"):
        emulator.advance(TRUTH_MS, 0)


def test_the_second_robot_lies_as_the_first_one_did(monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins with a copy of the first one's rest."""
    monkeypatch.setattr(emulator_module, "_AT_REST", {})
    first, second = Emulator(), Emulator()
    other = Emulator(EmulatorSettings(friction=0.3))
    assert len(emulator_module._AT_REST) == 2
    for _ in range(100):
        assert first.state_datagram() == second.state_datagram()
        for emulator in (first, second, other):
            emulator.receive(hold(A1.stand_pose))
            emulator.advance(5, 0)
    assert first.state_datagram() != other.state_datagram()
    np.testing.assert_array_equal(first.truth(), second.truth())
