"""MIT packets that other people's code made or read, against both of our ends.

Their code was run once, unchanged, on a machine without a bus, and its bytes written down here:

* damiao: cmjang/DM_Control_Python at 7da9387, controlMIT and the parser of its replies
* tmotor: neurobionics/TMotorCANControl at bb8d071, MIT_controller and parse_MIT_message
* dfki: dfki-ric-underactuated-lab/mini-cheetah-tmotor-python-can at 0ef9f89, send_rad_command and
  convert_raw_to_physical_rad, without the turned axis that it gives to some motors
* bgkatz: bgkatz/motorcontrol at 3586419, the firmware's unpack_cmd and pack_reply, for a PC

They cut off where we round to the nearest step. tmotor counts 2^n steps instead of 2^n - 1 and
stays two of them below the upper end.
"""

import numpy as np
import pytest

from rmll_hil.robot.mit_actuator import MitActuator
from rmll_onboard.protocol import mit_packets
from rmll_onboard.protocol.mit_packets import MitCommands, Ranges, Variant
from rmll_onboard.settings.can_settings import Model

FIRST = 0.25, -3.5, 40.0, 1.25, 2.5
SECOND = -1.57, 6.0, 300.0, 4.5, -7.0
THIRD = 12.0, -7.5, 0.0, 5.0, 0.5
FOURTH = -12.4, 0.75, 499.0, 0.01, -9.9
"""Position, velocity, kp, kd, torque"""

AK10 = 12.5, 50, 65
DM43 = 12.5, 30, 10

COMMANDS = [
    # who, ends of position, velocity and torque, what they were asked for, what they sent
    ("damiao", DM43, FIRST, "828e7101473ff9ff"),
    ("damiao", DM43, SECOND, "6feb999999e65266"),
    ("damiao", DM43, THIRD, "fae05ff000fff865"),
    ("damiao", DM43, FOURTH, "0106832ff6008014"),
    ("damiao", (12.5, 45, 54), FIRST, "828e7601473ff85e"),
    ("damiao", (12.5, 45, 54), SECOND, "6feb910999e656f6"),
    ("tmotor", AK10, FIRST, "828f77014740084e"),
    ("tmotor", AK10, SECOND, "6fec8f5999e66723"),
    ("tmotor", AK10, THIRD, "fae16cc000ffe80f"),
    ("tmotor", AK10, FOURTH, "010681eff70086c8"),
    ("tmotor", (12.5, 8, 144), FIRST, "828f480147400823"),
    ("tmotor", (12.5, 8, 144), SECOND, "6fece00999e6679c"),
    ("dfki", (95.5, 45, 18), FIRST, "80557601473ff91b"),
    ("dfki", (95.5, 45, 18), SECOND, "7de4910999e654e3"),
    ("dfki", (12.5, 76, 12), FIRST, "828e7a11473ff9aa"),
    ("dfki", (12.5, 76, 12), SECOND, "6feb8a1999e65355"),
    ("dfki", (12.5, 76, 12), THIRD, "fae0735000fff854"),
    ("dfki", (12.5, 76, 12), FOURTH, "0106813ff6008166"),
]
FIRMWARE = 12.5, 65, 18
"""bgkatz's defaults, with 18 N·m"""
READ_BY_THE_FIRMWARE = [
    ("8000800000000800", (0.000190734863, 0.01587677, 0, 0, 0.0043964386)),
    ("123456789abcdef0", (-10.7223244, -21.0952377, 268.864471, 3.68864465, 15.6175842)),
    ("fffefff00000fffe", (12.4996185, 65, 0, 0.0183150191, 17.9912071)),
    ("0000000fff000fff", (-12.5, -65, 500, 0, 18)),
    ("00000000003e8000", (-12.5, -65, 0, 1.22100127, -18)),
]
WRITTEN_BY_THE_FIRMWARE = [
    # number, position, velocity, torque; the last byte is the bus voltage
    (7, (1.5, -3.25, 2.0), "078f5b7998e399"),
    (1, (-12.5, 65, -18), "010000fff00000"),
    (12, (0.1, 0.2, 0.3), "0c8105805821f8"),
]
REPLIES: list[tuple[str, Variant, tuple, str, tuple, tuple[int, int]]] = [
    # who, kind of reply, ends, bytes, what they read; temperature and error
    ("tmotor", "ak", AK10, "07123456789a2804", (-10.722324, -16.227106, 4.904762), (40, 4)),
    ("tmotor", "ak", AK10, "0780007ff7ff1e00", (0.000191, -0.012210, -0.015873), (30, 0)),
    ("tmotor", "plain", AK10, "07ffffffffff", AK10, (0, 0)),
    ("dfki", "plain", (95.5, 45, 18), "07123456789a", (-81.918555, -14.604396, 1.358242), (0, 0)),
    ("dfki", "plain", (12.5, 76, 12), "07123456789a", (-10.722324, -24.665201, 0.905495), (0, 0)),
    ("dfki", "plain", (12.5, 76, 12), "0780007ff7ff", (0.000191, -0.018559, -0.002930), (0, 0)),
    # temperatures and status as i2rt's dm_driver.py has them; the parser leaves them out
    ("damiao", "damiao", DM43, "15123456789a2a21", (-10.722324, -9.736263, 0.754579), (42, 0)),
    ("damiao", "damiao", DM43, "1580007ff7ff3030", (0.000191, -0.007326, -0.002442), (48, 0)),
    ("damiao", "damiao", DM43, "1bfff0000fff6450", (12.494278, -30, 10), (100, 0)),
]  # fmt: skip


def ranges(position: float, velocity: float, torque: float) -> Ranges:
    return Ranges(*(np.array([end]) for end in (position, velocity, torque, 500.0, 5.0)))


def ours(ends: tuple, values: tuple) -> bytes:
    position, velocity, kp, kd, torque = (np.array([value]) for value in values)
    commands = MitCommands(position, velocity, kp, kd, torque)
    return mit_packets.encode_commands(ranges(*ends), commands)[0]


def actuator(ends: tuple, reply: Variant = "plain", number: int = 1) -> MitActuator:
    position, velocity, torque = ends
    return MitActuator(Model(position, velocity, torque, reply=reply), number)


def steps(data: bytes) -> list[int]:
    """Of position, velocity, kp, kd and torque, four and three hexadecimal digits each."""
    text = data.hex()
    return [int(text[a:b], 16) for a, b in ((0, 4), (4, 7), (7, 10), (10, 13), (13, 16))]


@pytest.mark.parametrize(("who", "ends", "asked", "sent"), COMMANDS)
def test_we_send_what_others_send(who, ends, asked, sent):
    theirs, here = steps(bytes.fromhex(sent)), steps(ours(ends, asked))
    apart = np.subtract(here, theirs)
    if who == "tmotor":
        assert np.abs(apart).max() <= 2
    else:  # cut off, where we round
        assert set(apart.tolist()) <= {0, 1}


@pytest.mark.parametrize(("who", "ends", "asked", "sent"), COMMANDS)
def test_the_emulated_actuator_reads_what_others_send(who, ends, asked, sent):
    read = actuator(ends).read(bytes.fromhex(sent))
    widths = (2 * ends[0] / 65535, 2 * ends[1] / 4095, 500 / 4095, 5 / 4095, 2 * ends[2] / 4095)
    off = np.abs(np.subtract(read, asked)) / widths
    assert off.max() < (2.1 if who == "tmotor" else 1.001)


@pytest.mark.parametrize(("sent", "read"), READ_BY_THE_FIRMWARE)
def test_the_firmware_reads_our_commands_as_they_were_meant(sent, read):
    assert ours(FIRMWARE, read).hex() == sent
    np.testing.assert_allclose(actuator(FIRMWARE).read(bytes.fromhex(sent)), read, atol=2e-5)


@pytest.mark.parametrize(("number", "measured", "sent"), WRITTEN_BY_THE_FIRMWARE)
def test_we_read_the_firmwares_replies(number, measured, sent):
    data = bytes.fromhex(sent)
    assert data[0] in mit_packets.first_bytes(number, "voltage")
    reply = mit_packets.decode_reply(data, "voltage")
    found = mit_packets.measured(ranges(*FIRMWARE), np.array([reply[:3]]).T)
    widths = (25 / 65535, 130 / 4095, 36 / 4095)
    assert (np.abs(np.ravel(found) - measured) <= np.multiply(widths, 1.001)).all()
    emulated = actuator(FIRMWARE, "voltage", number).reply(measured, 35, 0, True)
    # position, velocity and torque, where they cut off and we round
    apart = np.subtract(*(steps(data[1:6] + bytes(3))[:3] for data in (emulated, data)))
    assert emulated[0] == number and len(emulated) == len(data)
    assert set(apart.tolist()) <= {0, 1}


@pytest.mark.parametrize(("who", "variant", "ends", "data", "measured", "told"), REPLIES)
def test_we_read_replies_as_others_do(who, variant, ends, data, measured, told):
    reply = mit_packets.decode_reply(bytes.fromhex(data), variant)
    found = mit_packets.measured(ranges(*ends), np.array([reply[:3]]).T)
    np.testing.assert_allclose(np.ravel(found), measured, atol=1e-5)
    assert reply[3:] == told
    number = 5 if variant == "damiao" else 7
    emulated = actuator(ends, variant, number).reply(measured, told[0], told[1], True)
    assert emulated[1:6] == bytes.fromhex(data)[1:6]
