"""The can section of the settings file."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml

from rmll_common.errors import InputError
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.settings.can_settings import Actuator, Bus, Can, Imu, Model
from rmll_onboard.settings.runtime_settings import load_settings
from rmll_robots import A1

ROOT = Path(__file__).parents[2]


def changed(joint: str = "FR_hip_joint", **fields) -> Can:
    """The emulator's, with one actuator changed."""
    can = Can()
    actuator = msgspec.structs.replace(can.actuators[joint], **fields)
    return msgspec.structs.replace(can, actuators=can.actuators | {joint: actuator})


def test_the_emulators_own_fits_an_a1_and_stays_on_the_machine():
    can = Can()
    layout = Layout(can, A1)
    assert layout.bus == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert layout.id == [1, 2, 3] * 4
    assert all(bus.channel.startswith("ff01:") for bus in can.buses.values())
    assert len({bus.port for bus in can.buses.values()}) == 4


def test_the_example_fits_an_a1():
    settings = load_settings(ROOT / "onboard" / "can.yaml")
    assert settings.link.kind == "can"
    layout = Layout(settings.can, A1)
    middle = (A1.joint_lower + A1.joint_upper) / 2
    np.testing.assert_allclose(layout.to_joint(layout.to_actuator(middle)), middle)
    assert layout.commands() == [{1, 2, 3, 4, 5, 6}] * 2
    assert layout.answers() == [{0}, {0, 0x100, 0x101}]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: changed(bus="rear"), "actuator FR_hip_joint: unknown bus 'rear'; known: fr, fl"),
        (lambda: changed(model="AK"), "actuator FR_hip_joint: unknown model 'AK'; known: AK10-9"),
        (lambda: Can(imu=Imu("x")), "imu: unknown bus 'x'"),
        (lambda: changed(id=2), "bus fr: two actuators have id 2"),
        (lambda: changed(reply_id=3), "bus fr: id 3 is that of a command and of an answer"),
        (lambda: Can(imu=Imu("fr", 2)), "bus fr: id 2 is that of a command and of an answer"),
        (lambda: changed(reply_id=0x101), "bus fr: id 257 is that of the IMU and of a reply"),
        (lambda: Can(buses={n: Bus("udp_multicast", "ff01::1") for n in ("fr", "fl", "rr", "rl")}),
         "two udp_multicast buses have port 43113"),
        (lambda: Bus("udp_multicast", "239.74.163.2"), "expected a group ff01:"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_damiaos_on_one_master_id_need_numbers_that_differ_in_four_bits():
    models = {"AK10-9": Model(12.5, 50, 65, reply="damiao")}
    Can(models=models)
    can = Can()
    actuators = can.actuators | {"FR_hip_joint": Actuator("fr", 0x12, "AK10-9")}
    with pytest.raises(ValueError, match="may answer"):
        Can(models=models, actuators=actuators)
    apart = can.actuators | {"FR_hip_joint": Actuator("fr", 0x12, "AK10-9", reply_id=0x22)}
    Can(models=models, actuators=apart)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("imu: {bus: fr, id: 2047}", "<= 2046"),
        ("actuators: {FR_hip_joint: {bus: fr, id: 0, model: AK10-9}}", ">= 1"),
        ("actuators: {FR_hip_joint: {bus: fr, id: 1, model: AK10-9, sign: 2}}", "sign"),
        ("models: {a: {position: -1, velocity: 1, torque: 1}}", "> 0"),
        ("models: {a: {position: .nan, velocity: 1, torque: 1}}", "> 0"),
        ("models: {a: {position: 1, velocity: 1, torque: 1, reply: morse}}", "reply"),
        ("buses: {}", "length"),
        ("buses: {a: {interface: socketcan, channel: can0, speed: 3}}", "unknown field `speed`"),
    ],
)
def test_wrong_entries_are_refused(text, words):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(yaml.safe_load(text), Can)


@pytest.mark.parametrize(
    ("can", "words"),
    [
        (Can(actuators={}), "'FL_calf_joint' is missing; a1 has FR_hip_joint, FR_thigh"),
        (
            Can(actuators=Can().actuators | {"tail": Actuator("fr", 9, "AK10-9")}),
            "'tail' is unknown",
        ),
        (
            changed("FL_thigh_joint", offset=-10.0),
            "FL_thigh_joint: the joint's limit of 4.189 rad is 14.19 rad at the actuator, beyond",
        ),
        (Can(models={"AK10-9": Model(12.5, 50, 65, kp=50)}), "kp up to 50, a1 needs 80"),
        (Can(models={"AK10-9": Model(12.5, 50, 65, kd=1)}), "kd up to 1, a1 needs 3"),
    ],
)
def test_actuators_that_do_not_fit_the_robot_are_refused(can, words):
    with pytest.raises(InputError, match=words):
        Layout(can, A1)
