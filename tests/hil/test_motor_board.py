import mujoco
import numpy as np
import pytest

from rmll_hil.robot.motor_board import BRAKE_KD, MotorBoard
from rmll_hil.robot.world import World, load
from rmll_onboard.state.robot_state import MODE_BRAKE, MODE_SERVO, POS_STOP, VEL_STOP, MotorCommand
from rmll_robots import A1


@pytest.fixture
def world() -> World:
    world = load(A1, friction=0.8)
    # in the air and weightless, so that only the motors act
    world.model.opt.gravity[:] = 0
    world.data.qpos[2] = 1.0
    world.q[:] = A1.default_pose
    mujoco.mj_forward(world.model, world.data)
    return world


def servo(**targets: float) -> MotorCommand:
    fields = {name: np.full(12, value) for name, value in targets.items()}
    return MotorCommand(mode=np.full(12, MODE_SERVO, np.uint8), **fields)


def torque(world: World, board: MotorBoard, now_ms: int = 0) -> np.ndarray:
    """What the motors do in the present state, without letting time pass."""
    board.update(now_ms)
    mujoco.mj_forward(world.model, world.data)
    return world.torque.copy()


def test_servo_law(world: World) -> None:
    board = MotorBoard(world, A1, delay_ms=0, timeout_ms=50)
    command = servo(q=0.1, dq=-2.0, tau=1.5, kp=8.0, kd=0.25)
    world.dq[:] = np.linspace(-1, 1, 12)
    board.receive(command, 0)
    expected = 1.5 + 8.0 * (0.1 - world.q) + 0.25 * (-2.0 - world.dq)
    np.testing.assert_allclose(torque(world, board), expected, atol=1e-9)


def test_stop_values_switch_a_loop_off(world: World) -> None:
    board = MotorBoard(world, A1, delay_ms=0, timeout_ms=50)
    pos_stop, vel_stop = float(np.float32(POS_STOP)), float(np.float32(VEL_STOP))
    board.receive(servo(q=pos_stop, dq=0.0, tau=2.0, kp=8.0, kd=0.5), 0)
    world.dq[:] = 1.0
    np.testing.assert_allclose(torque(world, board), 2.0 - 0.5)
    board.receive(servo(q=0.0, dq=vel_stop, tau=2.0, kp=4.0, kd=0.5), 0)
    np.testing.assert_allclose(torque(world, board), 2.0 - 4.0 * world.q)


def test_absurd_targets_only_saturate(world: World) -> None:
    board = MotorBoard(world, A1, delay_ms=0, timeout_ms=50)
    board.receive(servo(q=-1e38, dq=1e38, tau=0.0, kp=1000.0, kd=0.0), 0)
    np.testing.assert_allclose(torque(world, board), -A1.torque_limit)


def test_every_other_mode_brakes(world: World) -> None:
    board = MotorBoard(world, A1, delay_ms=0, timeout_ms=50)
    command = servo(q=0.0, tau=9.0, kp=50.0)
    command.mode[:6] = MODE_BRAKE
    command.mode[6:] = 0x05
    board.receive(command, 0)
    world.dq[:] = 2.0
    np.testing.assert_allclose(torque(world, board), -BRAKE_KD * 2.0)
    assert (board.mode == MODE_BRAKE).all()


@pytest.mark.parametrize("speed", [0.0, 10.0, 21.0, 30.0])
def test_torque_fades_towards_the_speed_limit(world: World, speed: float) -> None:
    board = MotorBoard(world, A1, delay_ms=0, timeout_ms=50)
    with_motion = max(0.0, 33.5 * (1 - speed / 21.0))
    world.dq[:] = speed
    board.receive(servo(tau=100.0), 0)
    np.testing.assert_allclose(torque(world, board), with_motion)
    board.receive(servo(tau=-100.0), 0)
    np.testing.assert_allclose(torque(world, board), -33.5)
    world.dq[:] = -speed
    np.testing.assert_allclose(torque(world, board), -with_motion)


def test_a_command_acts_after_the_delay(world: World) -> None:
    board = MotorBoard(world, A1, delay_ms=5, timeout_ms=50)
    board.receive(servo(tau=3.0), 0)
    assert not torque(world, board, now_ms=4).any()
    np.testing.assert_allclose(torque(world, board, now_ms=5), 3.0)


def test_silence_brakes_and_a_new_command_revives(world: World) -> None:
    board = MotorBoard(world, A1, delay_ms=0, timeout_ms=50)
    board.receive(servo(tau=3.0), 100)
    world.dq[:] = 1.0
    np.testing.assert_allclose(torque(world, board, now_ms=150), 3.0)
    np.testing.assert_allclose(torque(world, board, now_ms=151), -BRAKE_KD)
    assert (board.mode == MODE_BRAKE).all()
    board.receive(servo(tau=3.0), 200)
    np.testing.assert_allclose(torque(world, board, now_ms=200), 3.0)
    assert (board.mode == MODE_SERVO).all()
