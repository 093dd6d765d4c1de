"""The actuators' frames, by known bytes and against the emulated actuator's own codec."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rmll_hil.robot.mit_actuator import MitActuator
from rmll_onboard.protocol import mit_packets
from rmll_onboard.protocol.mit_packets import MitCommands, Ranges, Reply
from rmll_onboard.settings.can_settings import Model
from rmll_onboard.state.packet_errors import BadPacket

N = 3
# AK80-6 V2, AK10-9, AK80-64
RANGES = Ranges(
    position=np.array([12.5, 12.5, 12.5]),
    velocity=np.array([76.0, 50.0, 8.0]),
    torque=np.array([12.0, 65.0, 144.0]),
    kp=np.full(N, 500.0),
    kd=np.full(N, 5.0),
)
SYMMETRIC = ("position", "velocity", "torque")


def actuators(reply: mit_packets.Variant = "plain", number: int = 1) -> list[MitActuator]:
    """With the ranges above."""
    names = (*SYMMETRIC, "kp", "kd")
    ends = [{name: float(getattr(RANGES, name)[each]) for name in names} for each in range(N)]
    return [MitActuator(Model(**end, reply=reply), number) for end in ends]


def heard(frames: list[bytes]) -> MitCommands:
    """What the actuators read."""
    targets = [actuator.read(data) for actuator, data in zip(actuators(), frames, strict=True)]
    rows = np.array(targets).T
    return MitCommands(**dict(zip(targets[0]._fields, rows, strict=True)))


numbers = st.floats(allow_nan=False) | st.floats(-200, 600)
commands = hnp.arrays(np.float64, (5, N), elements=numbers).map(lambda rows: MitCommands(*rows))


def step(name):
    """Width of a step [(n,)] of the command's field ``name``."""
    end = getattr(RANGES, name)
    top = 0xFFFF if name == "position" else 0xFFF
    return end * (2 if name in SYMMETRIC else 1) / top


def test_the_fields_stand_where_the_protocol_has_them():
    ranges = Ranges(*(np.ones(1) for _ in range(5)))

    def frame(**fields):
        lowest = {"position": -1.0, "velocity": -1.0, "kp": 0.0, "kd": 0.0, "torque": -1.0}
        values = (np.array([value]) for value in (lowest | fields).values())
        return mit_packets.encode_commands(ranges, MitCommands(*values))[0].hex()

    assert frame() == "0000000000000000"
    assert frame(position=1.0) == "fffe000000000000"
    assert frame(velocity=1.0) == "0000fff000000000"
    assert frame(kp=1.0) == "0000000fff000000"
    assert frame(kd=1.0) == "0000000000fff000"
    assert frame(torque=1.0) == "0000000000000fff"


def test_a_command_of_nothing_has_no_gain_and_hardly_a_torque():
    nothing = mit_packets.encode_commands(RANGES, MitCommands(*np.zeros((5, N))))
    assert [data.hex() for data in nothing] == ["8000800000000800"] * N
    torque = heard(nothing).torque
    np.testing.assert_allclose(torque, step("torque") / 2)  # twelve bits have no zero


@given(commands)
def test_commands_saturate_and_come_back_to_the_nearest_step(command):
    back = heard(mit_packets.encode_commands(RANGES, command))
    for name in MitCommands._fields:
        end = getattr(RANGES, name)
        low = -end if name in SYMMETRIC else np.zeros(N)
        # the highest position is given up for the special frames' sake
        high = end - step(name) * (name == "position")
        wanted = getattr(command, name).clip(low, high)
        error = np.abs(getattr(back, name) - wanted)
        assert (error <= step(name) * 0.5001).all(), name


@given(commands)
def test_a_command_is_a_fixed_point(command):
    once = mit_packets.encode_commands(RANGES, command)
    assert mit_packets.encode_commands(RANGES, heard(once)) == once


@given(commands)
def test_no_command_can_be_taken_for_a_special_frame(command):
    assert not any(
        data.startswith(b"\xff" * 7) for data in mit_packets.encode_commands(RANGES, command)
    )


def test_not_even_one_with_everything_at_its_end():
    most = MitCommands(*np.full((5, N), np.inf))
    assert mit_packets.encode_commands(RANGES, most) == [b"\xff\xfe" + b"\xff" * 6] * N


def test_there_is_no_frame_that_moves_the_zero():
    special = {name: value for name, value in vars(mit_packets).items() if isinstance(value, bytes)}
    assert special == {"ENTER": b"\xff" * 7 + b"\xfc", "EXIT": b"\xff" * 7 + b"\xfd"}


@pytest.mark.parametrize("field", range(5))
def test_what_is_no_number_is_not_sent(field):
    command = np.zeros((5, N))
    command[field, 1] = np.nan
    with pytest.raises(ValueError, match="numbers only"):
        mit_packets.encode_commands(RANGES, MitCommands(*command))


@given(
    hnp.arrays(np.float64, (N, 3), elements=numbers),
    st.integers(1, 255),
    st.integers(0, 127),
    st.sampled_from(list(mit_packets.LENGTH)),
)
def test_a_reply_tells_what_was_measured_to_the_nearest_step(rows, number, temperature, variant):
    replies = []
    for actuator, row in zip(actuators(variant, number), rows.tolist(), strict=True):
        data = actuator.reply(tuple(row), temperature, 0, True)
        assert len(data) == mit_packets.LENGTH[variant]
        assert data[0] in mit_packets.first_bytes(number, variant)
        replies.append(mit_packets.decode_reply(data, variant))
    found = mit_packets.measured(RANGES, np.array([reply[:3] for reply in replies]).T)
    for name, ours, theirs in zip(SYMMETRIC, found, rows.T, strict=True):
        end = getattr(RANGES, name)
        assert (np.abs(ours - theirs.clip(-end, end)) <= step(name) * 0.5001).all()
    tells = variant in ("ak", "damiao")
    assert {reply[3:] for reply in replies} == {(temperature if tells else 0, 0)}


def test_a_reply_of_known_bytes():
    reply = Reply(position=0x1234, velocity=0x567, torque=0x89A, temperature=-5, error=4)
    plain = mit_packets.decode_reply(bytes.fromhex("07123456789a"), "plain")
    assert plain == reply._replace(temperature=0, error=0)
    assert mit_packets.decode_reply(bytes.fromhex("07123456789afb04"), "ak") == reply
    hot = bytes.fromhex("b7123456789a6432")
    assert mit_packets.decode_reply(hot, "damiao")[3:] == (100, 11)
    assert mit_packets.ERRORS["damiao"][11] == "MOSFET too hot"


def test_an_ak_may_be_cold_and_a_damiao_not():
    freezing = [each.reply((0.0, 0.0, 0.0), -5, 4, True) for each in actuators("ak")]
    assert [mit_packets.decode_reply(data, "ak")[3:] for data in freezing] == [(-5, 4)] * N
    data = actuators("damiao")[0].reply((0.0, 0.0, 0.0), -5, 0, True)
    assert mit_packets.decode_reply(data, "damiao").temperature == 0


@pytest.mark.parametrize(("status", "error"), [(1, 0), (0, 16), (8, 8), (13, 13)])
def test_a_damiao_tells_its_status_beside_its_number(status, error):
    data = actuators("damiao", 0x25)[0].reply((0.0, 0.0, 0.0), 30, error % 16, error != 16)
    assert data[0] == status << 4 | 5
    assert mit_packets.decode_reply(data, "damiao").error == error


@given(st.binary(max_size=9), st.sampled_from(list(mit_packets.LENGTH)))
def test_replies_of_another_length_are_refused(data, variant):
    if len(data) == mit_packets.LENGTH[variant]:
        mit_packets.decode_reply(data, variant)
    else:
        with pytest.raises(BadPacket):
            mit_packets.decode_reply(data, variant)
