"""The world is mirror symmetric, and the learner sees each transition as it was or mirrored."""

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from rmll_gaits.errors import InputError
from rmll_gaits.load import load_gait
from rmll_gaits.symmetry import mirror_states
from rmll_gaits.table import MachineTable
from rmll_robots import A1
from rmll_train.environment import GaitEnv
from rmll_train.learner import GaitPPO
from rmll_train.mirroring import MirroredStorage, Reflection, reflection
from rmll_train.settings import Learner, Noise, Randomisation, Terminations, World
from rmll_train.simulation import Variation, training_model

GAITS = ("trot", "bound", "half_bound", "walk")
STILL = Randomisation(
    friction=(0.8, 0.8), added_mass=(0.0, 0.0), centre_of_mass=0.0, strength=(1.0, 1.0),
    delay=(0.0, 0.0), push_interval=1e6, initial_joint=0.0, initial_velocity=0.0,
    noise=Noise(0.0, 0.0, 0.0, 0.0),
)  # fmt: skip
ENDLESS = Terminations(-1.0, -1.0, 10.0, 1e6, 10.0)
SMALL = Learner(rollout=8, epochs=3, mini_batches=2, hidden=(32, 32), estimator_hidden=(16,),
                bf16=False, symmetry=True)  # fmt: skip
MIRROR_TWIST = torch.tensor([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def mirror_of(env: GaitEnv) -> Reflection:
    found = reflection(env, "auto")
    assert found is not None
    return found


def pair(gait: str, seed: int) -> GaitEnv:
    """A robot in a random state, and its mirror image."""
    table = load_gait(gait)
    env = GaitEnv(table, A1, World(envs=2, randomisation=STILL, terminations=ENDLESS), seed)
    both, one = torch.ones(2), torch.zeros(2)
    # the A1's trunk is 2 mm heavier on the left
    lopsided = float(training_model(A1).body("trunk").ipos[1])
    balance = torch.tensor([0.0, -lopsided, 0.0]).expand(2, 3)
    env.simulation.vary(Variation(0.8 * both, one, balance, both, one))
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
    env = GaitEnv(load_gait("walk"), A1, World(envs=4, profile=profile), 0)
    mirror, obs = mirror_of(env), env.get_observations()
    again = mirror.observations(mirror.observations(obs))
    assert all(torch.equal(again[name], obs[name]) for name in ("policy", "critic", "estimate"))


def rolled_out() -> GaitPPO:
    torch.manual_seed(0)
    env = GaitEnv(load_gait("trot"), A1, World(envs=16), 0)
    ppo = GaitPPO(env, SMALL)
    obs = env.get_observations()
    with torch.inference_mode():
        for _ in range(SMALL.rollout):
            obs, rewards, dones, extras = env.step(ppo.act(obs))
            ppo.process_env_step(obs, rewards, dones, extras)
        ppo.compute_returns(obs)
    return ppo


def test_each_transition_is_shown_once_an_epoch_as_it_was_or_mirrored() -> None:
    ppo = rolled_out()
    assert isinstance(ppo.storage, MirroredStorage) and ppo.reflection is not None
    # of the untouched rollout: a transition's stored probability tells it from all others
    observed = ppo.storage.observations.flatten(0, 1)
    actions, log_prob, returns = (
        stored.flatten(0, 1)
        for stored in (ppo.storage.actions, ppo.storage.actions_log_prob, ppo.storage.returns)
    )
    images, image_actions = ppo.reflection.observations(observed), ppo.reflection.actions(actions)
    row_of = {float(value): row for row, value in enumerate(log_prob)}
    mirrored, shown = 0, []
    for batch in ppo.storage.mini_batch_generator(SMALL.mini_batches, SMALL.epochs):
        with torch.no_grad():
            ppo.actor(batch.observations, stochastic_output=True)
        asked = ppo.actor.output_distribution_params
        for found, current in zip(batch.old_distribution_params, asked, strict=True):
            assert torch.allclose(found, current, atol=1e-5)
        for at, value in enumerate(batch.old_actions_log_prob):
            row = row_of[float(value)]
            shown.append(row)
            assert batch.returns[at] == returns[row]
            is_image = not torch.equal(batch.actions[at], actions[row])
            mirrored += is_image
            source, taken = (images, image_actions) if is_image else (observed, actions)
            assert torch.equal(batch.actions[at], taken[row])
            for name in ("policy", "critic"):
                assert torch.equal(batch.observations[name][at], source[name][row])
    count = len(observed)
    assert sorted(shown) == sorted(list(range(count)) * SMALL.epochs)
    assert 0.35 < mirrored / len(shown) < 0.65


def test_auto_learns_without_symmetry_where_there_is_none_and_true_refuses(
    lopsided: MachineTable,
) -> None:
    env = GaitEnv(lopsided, A1, World(envs=2), 0)
    assert reflection(env, "auto") is None
    with pytest.raises(InputError, match="gait trot has no mirror symmetry"):
        GaitPPO(env, SMALL)


def test_symmetry_can_be_turned_off() -> None:
    env = GaitEnv(load_gait("trot"), A1, World(envs=2), 0)
    ppo = GaitPPO(env, replace(SMALL, symmetry=False))
    assert ppo.reflection is None and not isinstance(ppo.storage, MirroredStorage)


@pytest.fixture
def lopsided() -> MachineTable:
    table = load_gait("trot")
    return replace(table, dwell=table.dwell * [[1.0], [0.5]])
