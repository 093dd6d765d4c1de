"""What a joint angle means and where it is in a packet, against numbers of its own.

Kinematics by hand from the A1's lengths (hips at x = 0.183, y = 0.047 m; 0.08505 m to the thigh's
plane; thigh and calf 0.2 m), x forward, y left, z up; packet offsets from the vendor's header:
motors FR_0, FR_1, FR_2, FL_0, ... RL_2, legs FR, FL, RR, RL, in each hip, thigh, calf.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

import struct

import mujoco
import numpy as np
import pytest

from rmll_hil.robot.emulator import Emulator
from rmll_onboard.protocol.a1_packets import encode_command
from rmll_onboard.state.robot_state import MODE_SERVO, MotorCommand
from rmll_robots import A1

COMMAND_MOTOR, COMMAND_SIZE = 10, 27
STATE_MOTOR, STATE_SIZE, STATE_FEET = 63, 32, 703
"""Offsets and sizes [bytes]; a motor begins with its mode, one byte, and its angle, a float"""
WIRE_JOINTS = [
    f"{leg}_{joint}_joint" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")
]


@pytest.fixture
def emulator() -> Emulator:
    return Emulator()


def put(emulator: Emulator, height: float = 1.0, **angles: float) -> None:
    """The robot level and at rest, at a height [m], with these joint angles [rad], the others 0."""
    model, data = emulator.world.model, emulator.world.data
    data.qpos[:7] = 0, 0, height, 1, 0, 0, 0
    data.qpos[7:] = data.qvel[:] = 0
    for name, angle in angles.items():
        data.qpos[model.joint(f"{name}_joint").qposadr[0]] = angle
    mujoco.mj_forward(model, data)


def foot(emulator: Emulator, leg: str) -> np.ndarray:
    """(3,) [m] from the trunk."""
    data = emulator.world.data
    return data.site(f"{leg}_foot").xpos - data.body("trunk").xpos


@pytest.mark.parametrize(
    ("leg", "hip", "thigh", "calf", "expected"),
    [
        ("FR", 0.0, 0.0, 0.0, (0.183, -0.13205, -0.4)),
        ("RL", 0.0, 0.0, 0.0, (-0.183, 0.13205, -0.4)),
        # positive: the leg swings to the left, whichever side it is on
        ("FR", 0.3, 0.0, 0.0, (0.183, -0.01004, -0.40727)),
        ("RR", 0.3, 0.0, 0.0, (-0.183, -0.01004, -0.40727)),
        ("FL", 0.3, 0.0, 0.0, (0.183, 0.24646, -0.35700)),
        # positive: the foot goes backwards
        ("FL", 0.0, 0.5, 0.0, (0.183 - 0.19177, 0.13205, -0.35103)),
        ("RR", 0.0, 0.5, 0.0, (-0.183 - 0.19177, -0.13205, -0.35103)),
        # negative, as all are: the knee points backwards and the foot comes forward again
        ("FR", 0.0, 0.8, -1.5, (0.183 - 0.01463, -0.13205, -0.29231)),
        ("RL", 0.0, 0.8, -1.5, (-0.183 - 0.01463, 0.13205, -0.29231)),
    ],
)
def test_where_a_foot_is(
    emulator: Emulator, leg: str, hip: float, thigh: float, calf: float, expected: tuple
) -> None:
    put(emulator, **{f"{leg}_hip": hip, f"{leg}_thigh": thigh, f"{leg}_calf": calf})
    np.testing.assert_allclose(foot(emulator, leg), expected, atol=2e-5)


def test_the_default_pose_is_that_of_legged_gym() -> None:
    """Left hips outwards is positive, right ones negative; the rear thighs lean back more."""
    pose = dict(zip(A1.joint_names, A1.default_pose, strict=True))
    for leg, hip, thigh in (("FL", 0.1, 0.8), ("FR", -0.1, 0.8), ("RL", 0.1, 1.0), ("RR", -0.1, 1)):
        assert [pose[f"{leg}_{joint}_joint"] for joint in ("hip", "thigh", "calf")] == [
            hip, thigh, -1.5,
        ]  # fmt: skip


@pytest.mark.parametrize("slot", range(12))
def test_a_joint_of_the_world_is_in_its_slot_of_the_state(emulator: Emulator, slot: int) -> None:
    put(emulator, **{WIRE_JOINTS[slot].removesuffix("_joint"): -0.7})
    packet = emulator.state_datagram()
    read = [
        struct.unpack_from("<f", packet, STATE_MOTOR + STATE_SIZE * each + 1)[0]
        for each in range(20)
    ]
    expected = np.zeros(20)
    expected[slot] = -0.7
    np.testing.assert_allclose(read, expected, atol=0.05)


@pytest.mark.parametrize("slot", range(12))
def test_a_slot_of_the_command_moves_its_joint_the_way_it_says(
    emulator: Emulator, slot: int
) -> None:
    start = np.tile([0.0, 0.8, -1.5], 4)
    put(emulator, **dict(zip((n.removesuffix("_joint") for n in WIRE_JOINTS), start, strict=True)))
    target = start.copy()
    target[slot] += 0.3
    packet = encode_command(
        MotorCommand(
            mode=np.full(12, MODE_SERVO, np.uint8),
            q=target,
            kp=np.full(12, 50.0),
            kd=np.full(12, 2.0),
        )
    )
    sent = struct.unpack_from("<f", packet, COMMAND_MOTOR + COMMAND_SIZE * slot + 1)[0]
    assert sent == pytest.approx(start[slot] + 0.3)
    emulator.receive(packet)
    emulator.advance(40, 0)
    data = emulator.world.data
    moved = np.array([data.joint(name).qpos[0] for name in WIRE_JOINTS]) - start
    assert int(np.abs(moved).argmax()) == slot
    assert moved[slot] > 0.05


@pytest.mark.parametrize(("place", "leg"), list(enumerate(("FR", "FL", "RR", "RL"))))
def test_the_foot_that_bears_the_weight_is_in_its_place(
    emulator: Emulator, place: int, leg: str
) -> None:
    """One leg is long and the others are folded."""
    angles = {}
    for each in ("FR", "FL", "RR", "RL"):
        thigh, calf = (0.46, -0.92) if each == leg else (1.36, -2.65)
        angles |= {f"{each}_thigh": thigh, f"{each}_calf": calf}
    air, ground = (feet(emulator, height, angles) for height in (1.0, 0.376))
    assert int(np.subtract(ground, air).argmax()) == place


def feet(emulator: Emulator, height: float, angles: dict[str, float]) -> tuple[int, ...]:
    """(4,) raw, as the packet has them; a sensor takes its time."""
    put(emulator, height, **angles)
    for _ in range(50):
        packet = emulator.state_datagram()
        emulator.now_ms += 2
    return struct.unpack_from("<4h", packet, STATE_FEET)
