"""The world is mirror symmetric, and so is a folded policy."""

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from rmll_common.errors import InputError
from rmll_contract.mirror import mirror_action, mirror_layout
from rmll_gaits.load import load_gait
from rmll_gaits.symmetry import mirror_states
from rmll_gaits.table import MachineTable
from rmll_robots import A1
from rmll_train.env.environment import GaitEnv
from rmll_train.env.simulation import Variation, training_model
from rmll_train.golden_trace import STILL
from rmll_train.learning.gait_ppo import GaitPPO
from rmll_train.learning.network_symmetry import Mirrored, images
from rmll_train.train_settings import EnvSettings, LearnerSettings, Terminations

GAITS = ("trot", "bound", "half_bound", "walk")
ENDLESS = Terminations(-1.0, -1.0, 10.0, 1e6, 10.0)
SMALL = LearnerSettings(rollout=8, epochs=3, mini_batches=2, hidden=(32, 32),
                        estimator_hidden=(16,), bf16=False, symmetry=True)  # fmt: skip
MIRROR_TWIST = torch.tensor([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


class Glass:
    """The mirror image of everything an environment shows and takes."""

    def __init__(self, env: GaitEnv):
        states = images(env.table, True)
        self._groups = {name: Mirrored(mirror_layout(fields, states))
                        for name, fields in env.groups.items()}  # fmt: skip
        self._action = Mirrored(mirror_action(env.robot))

    def observations(self, obs: TensorDict) -> TensorDict:
        all_of_them = torch.ones(len(obs), 1)
        shown = {name: mirror(obs[name], all_of_them) for name, mirror in self._groups.items()}
        return TensorDict(shown, batch_size=obs.batch_size)

    def actions(self, actions: torch.Tensor) -> torch.Tensor:
        return self._action(actions, torch.ones(*actions.shape[:-1], 1))


def mirror_of(env: GaitEnv) -> Glass:
    return Glass(env)


def pair(gait: str, seed: int) -> GaitEnv:
    """A robot in a random state, and its mirror image."""
    table = load_gait(gait)
    env = GaitEnv(table, A1, EnvSettings(envs=2, randomisation=STILL, terminations=ENDLESS), seed)
    both, none = torch.ones(2), torch.zeros(2)
    # the A1's trunk is 2 mm heavier on the left
    lopsided = float(training_model(A1).body("trunk").ipos[1])
    balance = torch.tensor([0.0, -lopsided, 0.0]).expand(2, 3)
    env.simulation.vary(Variation(0.8 * both, none, balance, both, none, none))
    joints = torch.tensor(A1.default_pose, dtype=torch.float32) + 0.2 * torch.randn(12)
    twist = 0.4 * torch.randn(6)
    joints = torch.stack([joints, mirror_of(env).actions(joints)])
    twist = torch.stack([twist, twist * MIRROR_TWIST])
    env.simulation.place(torch.arange(2), torch.zeros(2, 2), joints, twist)
    images = mirror_states(table)
    assert images is not None
    state = int(torch.randint(table.num_states - (table.sink is not None), ()))
    env.state[:] = torch.tensor([state, images[state]])
    env.episode_length_buf[:] = int(table.grace.max())
    env.fix_commands(torch.tensor([[0.4, 0.3, 6.0], [0.4, -0.3, 6.0]]))
    return env


def difference(one: TensorDict, other: TensorDict) -> float:
    return max(float((one[name] - other[name]).abs().max()) for name in ("policy", "critic"))


@pytest.mark.parametrize("gait", GAITS)
def test_mirrored_actions_lead_mirrored_robots_to_mirrored_observations(gait: str) -> None:
    torch.manual_seed(GAITS.index(gait))
    for seed in range(3):
        env = pair(gait, seed)
        mirror = mirror_of(env)
        for _ in range(20):
            obs = env.get_observations()
            assert difference(mirror.observations(obs[:1]), obs[1:]) < 1e-5
            assert torch.allclose(
                mirror.observations(obs[:1])["estimate"], obs["estimate"][1:], atol=1e-5
            )
            action = torch.randn(1, 12)
            _, rewards, done, _ = env.step(torch.cat([action, mirror.actions(action)]))
            assert torch.allclose(rewards[0], rewards[1], rtol=1e-3, atol=1e-6)
            assert done[0] == done[1]
            if done.any():
                break


def test_a_robot_that_leans_does_not_look_like_its_own_mirror_image() -> None:
    torch.manual_seed(0)
    obs = pair("trot", 0).get_observations()
    assert difference(obs[:1], obs[1:]) > 0.1


@pytest.mark.parametrize("profile", ["paper", "imu"])
def test_the_image_of_the_image_is_the_observation(profile: str) -> None:
    env = GaitEnv(load_gait("walk"), A1, EnvSettings(envs=4, profile=profile), 0)
    mirror, obs = mirror_of(env), env.get_observations()
    again = mirror.observations(mirror.observations(obs))
    assert all(
        torch.allclose(again[name], obs[name], atol=1e-6)
        for name in ("policy", "critic", "estimate")
    )


@pytest.mark.parametrize("gait, half", [("trot", {1}), ("walk", {2, 3}), ("half_bound", {2, 3})])
def test_a_folded_policy_is_as_symmetric_as_its_gait(gait: str, half: set[int]) -> None:
    torch.manual_seed(0)
    env = GaitEnv(load_gait(gait), A1, EnvSettings(envs=64), 0)
    ppo, mirror = GaitPPO(env, SMALL), mirror_of(env)
    obs = env.get_observations()
    image = mirror.observations(obs)
    fold = ppo.policy.fold
    assert {s for s, turned in enumerate(fold.turned_states.tolist()) if turned} == half
    with torch.no_grad():
        action, mirrored = ppo.policy(obs), ppo.policy(image)
        estimates = ppo.policy.estimate(obs["policy"]), ppo.policy.estimate(image["policy"])
        values = ppo.critic(obs), ppo.critic(image)
    assert torch.allclose(mirror.actions(action), mirrored, atol=1e-5)
    assert not torch.allclose(action, mirrored, atol=1e-2)
    turned = torch.ones(64, 1)
    assert torch.allclose(fold.estimate(estimates[0], turned), estimates[1], atol=1e-5)
    assert torch.allclose(values[0], values[1], atol=1e-5)


def test_a_state_that_is_its_own_image_is_never_turned() -> None:
    env = GaitEnv(load_gait("bound"), A1, EnvSettings(envs=8), 0)
    ppo = GaitPPO(env, SMALL)
    assert not ppo.policy.fold.used


def test_auto_learns_without_symmetry_where_there_is_none_and_true_refuses(
    lopsided: MachineTable,
) -> None:
    assert images(lopsided, "auto") == (0, 1)
    env = GaitEnv(lopsided, A1, EnvSettings(envs=2), 0)
    with pytest.raises(InputError, match="gait trot has no mirror symmetry"):
        GaitPPO(env, SMALL)


def test_symmetry_can_be_turned_off() -> None:
    env = GaitEnv(load_gait("trot"), A1, EnvSettings(envs=2), 0)
    assert not GaitPPO(env, replace(SMALL, symmetry=False)).policy.fold.used


@pytest.fixture
def lopsided() -> MachineTable:
    table = load_gait("trot")
    return replace(table, dwell=table.dwell * [[1.0], [0.5]])
