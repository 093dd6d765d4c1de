"""Both ends of CAN, datagram for datagram: the wire of the daemon and the emulated actuators."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_hil.robot.can_robot import CanRobot
from rmll_onboard.control.leg_force import LegForce
from rmll_onboard.interface.can_interface import CanInterface
from rmll_onboard.protocol.can_frame import Frame, pack, unpack
from rmll_onboard.protocol.mit_packets import ENTER, EXIT, Variant
from rmll_onboard.settings.can_settings import Actuator, Bus, Can, Imu, Model
from rmll_onboard.state.robot_state import (
    MODE_BRAKE,
    MODE_SERVO,
    POS_STOP,
    MotorCommand,
    RobotState,
)
from rmll_robots import A1

PERIOD = 5_000_000
ZERO = b"\xff" * 7 + b"\xfe"


def mixed(variant: Variant = "ak") -> Can:
    """Two buses, mirrored and shifted joints, two kinds of actuators."""
    models = {
        "small": Model(12.5, 45.0, 24.0, reply=variant),
        "large": Model(12.5, 25.0, 65.0, reply=variant),
    }
    actuators = {
        joint: Actuator(
            bus="right" if joint[1] == "R" else "left",
            id=3 + number % 6 + 6 * (number > 5),
            model="large" if "calf" in joint else "small",
            reply_id=0x20,
            sign=-1 if joint[1] == "R" else 1,
            offset=0.1 * number,
        )
        for number, joint in enumerate(A1.joint_names)
    }
    buses = {name: Bus("virtual", name) for name in ("right", "left")}
    imu = Imu("left", 0x300)
    return Can(buses=buses, models=models, actuators=actuators, imu=imu, reply_timeout_ms=25.0)


class Pair:
    """A wire and actuators that take turns on a clock of their own."""

    def __init__(self, can: Can, built: Can | None = None) -> None:
        """``can`` is what the daemon is told, ``built`` how the robot is, if otherwise."""
        self.robot = CanRobot(built or can, A1)
        self.wire = CanInterface(can, A1)
        self.state = RobotState(quaternion=np.array([1.0, 0, 0, 0]), q=A1.stand_pose.copy())
        self.now = 0
        self.command = MotorCommand(q=A1.stand_pose.copy(), kd=np.full(12, 5.0))
        self.heard: MotorCommand | None = None
        self.sent: list[bytes] = []

    def tick(self, keep=lambda frame: True) -> bool:
        """One period; ``keep`` says which of the robot's frames arrive."""
        datagram = self.wire.opening() or self.wire.encode(self.command)
        self.sent.append(datagram)
        self.heard = self.robot.hear(datagram, lambda: self.state)
        self.now += PERIOD
        self.state.tick += 5
        frames = [frame for frame in unpack(self.robot.tell(self.state)) if keep(frame)]
        return self.wire.take(self.now, [pack(frames)] if frames else [], resting=False)

    def open(self) -> "Pair":
        for _ in range(20):
            if self.tick():
                return self
        raise AssertionError("never a whole state")


@pytest.fixture
def pair() -> Pair:
    return Pair(mixed()).open()


def test_the_actuators_are_switched_on_before_the_first_state(pair):
    frames = [{frame.data for frame in unpack(datagram)} for datagram in pair.sent]
    assert frames[1::2] == [{ENTER}] * 3
    assert not any(ENTER in data for data in frames[::2])
    assert pair.robot.on.all()
    assert pair.tick()
    assert ENTER not in {frame.data for frame in unpack(pair.sent[-1])}
    assert pair.wire.received == 2


@pytest.mark.parametrize("variant", ["plain", "voltage", "ak", "damiao"])
def test_commands_and_states_arrive_through_signs_offsets_and_ranges(variant):
    pair = Pair(mixed(variant))
    random = np.random.default_rng(1)
    state, command = pair.state, pair.command
    state.q[:] = random.uniform(A1.joint_lower, A1.joint_upper)
    state.dq[:] = random.uniform(-20, 20, 12)
    state.tau[:] = random.uniform(-20, 20, 12)
    state.gyro[:] = random.uniform(-5, 5, 3)
    state.quaternion[:] = 0.9, 0.1, 0.3, 0.3  # of length 1
    state.temperature[:] = range(30, 42)
    command.q[:] = random.uniform(A1.joint_lower, A1.joint_upper)
    command.dq[:] = random.uniform(-20, 20, 12)
    command.tau[:] = random.uniform(-20, 20, 12)
    command.kp[:] = random.uniform(1, 80, 12)
    command.kd[:] = random.uniform(0, 5, 12)
    pair.open()
    pair.tick()
    found, heard = pair.wire.state, pair.heard
    assert heard
    for ours, theirs, step in (
        (found.q, state.q, 25 / 65535),
        (found.dq, state.dq, 90 / 4095),
        (found.tau, state.tau, 130 / 4095),
        (found.gyro, state.gyro, 1 / 900),
        (found.quaternion, state.quaternion, 1 / 32767),
        (heard.q, command.q, 25 / 65535),
        (heard.dq, command.dq, 90 / 4095),
        (heard.tau, command.tau, 130 / 4095),
        (heard.kp, command.kp, 500 / 4095),
        (heard.kd, command.kd, 5 / 4095),
    ):
        np.testing.assert_allclose(ours, theirs, atol=0.501 * step)
    tells = variant in ("ak", "damiao")
    assert found.temperature.tolist() == (list(range(30, 42)) if tells else [0] * 12)
    assert (heard.mode == MODE_SERVO).all()
    assert (found.mode == MODE_SERVO).all()


def test_an_actuator_mounted_the_other_way_is_not_what_the_settings_say():
    can = mixed()
    actuators = dict(can.actuators)
    joint, turned = "FL_thigh_joint", actuators["FL_thigh_joint"]
    actuators[joint] = msgspec.structs.replace(turned, sign=-turned.sign)
    pair = Pair(can, msgspec.structs.replace(can, actuators=actuators))
    pair.state.dq[:] = pair.state.tau[:] = 3.0
    pair.command.dq[:] = 2.0
    pair.open().tick()
    here = A1.joint_names.index(joint)
    expected = np.where(np.arange(12) == here, -1.0, 1.0)
    np.testing.assert_allclose(pair.wire.state.dq, 3.0 * expected, atol=0.02)
    np.testing.assert_allclose(pair.wire.state.tau, 3.0 * expected, atol=0.02)
    np.testing.assert_allclose(pair.heard.dq, 2.0 * expected, atol=0.02)
    mirrored = 2 * turned.offset - pair.state.q[here]
    assert pair.wire.state.q[here] == pytest.approx(mirrored, abs=1e-3)


def test_a_robot_with_other_joints_is_refused():
    can = mixed()
    actuators = {name: each for name, each in can.actuators.items() if name != "RL_calf_joint"}
    with pytest.raises(InputError, match="can: actuators: expected one for each of FR_hip_joint"):
        CanRobot(msgspec.structs.replace(can, actuators=actuators), A1)


def test_damping_asks_for_no_position(pair):
    pair.command = MotorCommand(q=np.full(12, POS_STOP), kd=np.full(12, 5.0))
    pair.tick()
    assert not pair.heard.kp.any()
    np.testing.assert_allclose(pair.heard.kd, 5.0)
    assert np.abs(pair.heard.tau).max() < 0.02


def test_actuators_obey_only_while_switched_on(pair):
    robot, state = pair.robot, pair.state
    parting = pack(Frame(f.bus, f.id, EXIT) for f in unpack(pair.sent[-1]))
    assert (robot.hear(parting, lambda: state).mode == MODE_BRAKE).all()
    again = robot.hear(pair.wire.encode(pair.command), lambda: state)
    assert (again.mode == MODE_BRAKE).all()
    assert len(list(unpack(robot.tell(state)))) == 12 + 12 + 2  # they answer nevertheless


def test_an_order_to_move_the_zero_is_none_of_the_emulated(pair):
    before = pair.heard
    zero = pack(Frame(f.bus, f.id, ZERO) for f in unpack(pair.sent[-1]))
    after = pair.robot.hear(zero, lambda: pair.state)
    np.testing.assert_array_equal(after.q, before.q)
    assert pair.robot.on.all()


def test_a_state_is_none_before_all_have_been_heard():
    pair = Pair(mixed())
    silent = pair.wire._layout.id[4]
    for _ in range(30):
        assert not pair.tick(lambda frame: frame.data[0] != silent or frame.bus == 0)
    assert pair.wire.received == 0
    assert pair.wire.missing == "actuator FL_thigh_joint"
    assert pair.wire.fault is None


def test_a_single_lost_answer_is_no_fault(pair):
    assert pair.tick(lambda frame: frame.id >= 0x300)  # the IMU alone
    assert pair.tick()
    assert pair.wire.fault is None


@pytest.mark.parametrize(
    ("lost", "name"),
    [
        (lambda frame: frame.bus == 0 and frame.data[0] == 3, "actuator FR_hip_joint"),
        (lambda frame: frame.id >= 0x300, "the IMU"),
        (lambda frame: frame.id == 0x300, "the IMU"),
        (lambda frame: frame.id == 0x301, "the IMU"),
        (lambda frame: frame.bus == 0, "actuator FR_hip_joint"),
        (lambda frame: True, "actuator FR_hip_joint"),
    ],
)
def test_who_falls_silent_is_a_fault_in_time(pair, lost, name):
    pair.state.gyro[:] = 1.0
    for _ in range(5):
        pair.tick(lambda frame: not lost(frame))
        assert pair.wire.fault is None
    pair.tick(lambda frame: not lost(frame))
    assert pair.wire.fault == f"{name} has been silent for more than 25 ms"
    for _ in range(10):
        pair.tick()
    assert pair.wire.fault  # it stays


@pytest.mark.parametrize(
    ("variant", "error", "words"),
    [
        ("ak", 4, "reports error 4: under-voltage"),
        ("ak", 99, "reports error 99: unknown"),
        ("damiao", 11, "reports error 11: MOSFET too hot"),
    ],
)
def test_an_actuators_error_is_a_fault_at_once(variant, error, words):
    pair = Pair(mixed(variant)).open()
    pair.robot.errors[7] = error
    pair.tick()
    assert pair.wire.fault == f"actuator RR_thigh_joint {words}"


def test_a_damiao_that_switches_itself_off_is_a_fault():
    pair = Pair(mixed("damiao")).open()
    pair.robot.on[0] = False
    pair.tick()
    assert pair.wire.fault == "actuator FR_hip_joint reports error 16: switched off"


def test_an_imu_whose_clock_stands_still_counts_as_silent(pair):
    for _ in range(6):
        pair.state.tick -= 5
        pair.tick()
    assert pair.wire.fault.startswith("the IMU")


def test_the_imus_clock_may_start_again_after_16_bits(pair):
    pair.state.tick = 65534
    for _ in range(10):
        assert pair.tick()
    assert pair.wire.fault is None


def test_measurements_that_do_not_change_do_not_count_as_changed(pair):
    changed = pair.wire.changed
    pair.tick()
    assert pair.wire.changed == changed < pair.wire.heard
    pair.state.q[3] += 0.01
    pair.tick()
    assert pair.wire.changed == pair.wire.heard


def test_standing_feet_press_and_a_lifted_one_does_not(pair):
    """Torques that hold 30 N at each foot of a level robot, as tests/hil/test_leg_force.py."""
    calf = 0.2 * np.sin(0.7)
    thigh = calf - 0.2 * np.sin(0.8)
    tau = 30.0 * np.tile([0.0, thigh, calf], 4)
    tau[0::3] = -30.0 * A1.leg.hip_offset * np.array([-1, 1, -1, 1])
    tau[3:6] = 0.0  # FL
    pair.state.tau[:] = tau
    pair.tick()
    state = pair.wire.state
    found = LegForce(A1).step(state.q, state.tau, np.array([0.0, 0, -1]))
    np.testing.assert_allclose(found, [30, 0, 30, 30], atol=1.5)
    assert not pair.wire.streams.feet
    assert not state.foot_force.any()  # no raw units are made up


def hostile() -> st.SearchStrategy[bytes]:
    """Frames with identifiers that mean something, and plain noise."""
    identifiers = st.sampled_from([0x20, 0x300, 0x301]) | st.integers(0, 0x7FF)
    first = st.integers(0, 20).map(lambda byte: bytes([byte]))
    data = st.tuples(first, st.binary(max_size=7)).map(b"".join) | st.just(b"")
    frames = st.lists(st.builds(Frame, st.integers(0, 3), identifiers, data), max_size=8)
    return frames.map(pack) | st.binary(max_size=60)


@pytest.mark.fuzz
@given(st.lists(hostile(), max_size=4))
def test_hostile_datagrams_raise_nothing_and_damp_at_worst(datagrams):
    pair = Pair(mixed()).open()
    for datagram in datagrams:
        pair.now += PERIOD
        pair.wire.take(pair.now, [datagram], resting=False)
        pair.wire.encode(pair.command)
    assert np.isfinite(pair.wire.state.q).all()
    assert np.isfinite(pair.wire.state.dq).all()
