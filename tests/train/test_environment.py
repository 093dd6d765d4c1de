"""The learning environment: what the policy sees, what it earns, and that bad physics is caught."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from rmll_contract import observation
from rmll_gaits import label, machine
from rmll_gaits.load import load_gait
from rmll_gaits.machine import Machine
from rmll_gaits.table import Commands
from rmll_robots import A1
from rmll_train.env import reward, terminations
from rmll_train.env.environment import GaitEnv
from rmll_train.env.simulation import Simulation
from rmll_train.golden_trace import ALIKE
from rmll_train.train_settings import (
    EnvSettings,
    GroundSettings,
    ObservationNoise,
    Randomisation,
    Rewards,
    Terminations,
    TrainSettings,
    paper,
)

ENVS = 16
FINE = reward.FineWidths.of(load_gait("trot").commands, Rewards())


def make(gait: str = "trot", seed: int = 0, **world) -> GaitEnv:
    return GaitEnv(load_gait(gait), A1, EnvSettings(envs=ENVS, **world), seed)


def random_actions(env: GaitEnv, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(env.num_envs, env.num_actions, generator=generator)


def still(command: torch.Tensor) -> reward.BaseMotion:
    """Of robots that do not act and land no foot, under ``command`` (ENVS, 3)."""
    nothing = torch.zeros(ENVS, 12)
    return reward.BaseMotion(command, nothing, nothing, nothing, torch.zeros(ENVS, 4))


@pytest.mark.parametrize("gait, states", [("trot", 2), ("walk", 4), ("half_bound", 5)])
def test_the_paper_profile_has_47_numbers_and_the_states(gait: str, states: int) -> None:
    env = make(gait, profile="paper")
    groups = env.get_observations()
    estimates = observation.size(observation.ESTIMATES)
    assert groups["policy"].shape == (ENVS, 47 + states - estimates)
    assert groups["estimate"].shape == (ENVS, estimates)


def test_the_actor_sees_no_true_velocity() -> None:
    names = {field.name for field in make().layout}
    assert not names & {"velocity", "base_velocity", "foot_height"}


def test_one_seed_gives_one_world() -> None:
    first, second = make(seed=3), make(seed=3)
    for step in range(40):
        action = random_actions(first, step)
        a, b = first.step(action), second.step(action)
        assert torch.equal(a[0]["policy"], b[0]["policy"])
        assert torch.equal(a[1], b[1]) and torch.equal(a[2], b[2])


def test_another_seed_gives_another_world() -> None:
    assert not torch.equal(make(seed=1).command, make(seed=2).command)


def test_a_saved_world_goes_on_as_if_nothing_had_happened() -> None:
    env = make(seed=5)
    for step in range(15):
        env.step(random_actions(env, step))
    saved = env.state_dict()
    expected = [env.step(random_actions(env, 100 + step))[1] for step in range(10)]
    other = make(seed=99)
    other.load_state_dict(saved)
    found = [other.step(random_actions(other, 100 + step))[1] for step in range(10)]
    # the solver's warm start is part of the state, so the physics agree to rounding
    assert torch.allclose(torch.stack(found), torch.stack(expected), atol=1e-4)


def test_the_automaton_agrees_with_a_numpy_replay_of_its_labels() -> None:
    env = make("three_one", seed=1)
    table = Machine.of(env.table)
    down = np.ones((ENVS, 4), bool)
    state, phi = env.state.numpy().copy(), np.zeros(ENVS, int)
    for count in range(60):
        age, frequency = env.episode_length_buf.numpy().copy(), env.command[:, 2].numpy().copy()
        _, _, done, _ = env.step(0.5 * random_actions(env, count))
        # a finished episode starts anew inside step(): follow only the others
        down = label.hysteresis(down, env.contacts.touching.numpy(), env.contacts.clear.numpy())
        step = machine.step(table, state, phi, label.label(down.astype(int)), frequency, age)
        going = ~done.numpy()
        assert np.array_equal(env.state.numpy()[going], step.state[going])
        assert np.array_equal(env.phi.numpy()[going], step.phi[going])
        down[~going], state, phi = True, step.state, step.phi
        state[~going], phi[~going] = env.state.numpy()[~going], 0


def test_a_transition_earns_the_bonus_on_its_own_step() -> None:
    table, plain_rewards = load_gait("trot"), Rewards(bonus_source="step", bonus=1.0)
    env = GaitEnv(table, A1, EnvSettings(envs=64, rewards=replace(plain_rewards, bonus=1000.0)), 0)
    plain = GaitEnv(table, A1, EnvSettings(envs=64, rewards=plain_rewards), 0)
    seen = 0
    for count in range(200):
        action = random_actions(env, count)
        before = env.phi.clone()
        _, with_bonus, done, _ = env.step(action)
        _, without, _, _ = plain.step(action)
        advanced = (env.phi == 0) & (before > 0) & ~done
        seen += int(advanced.sum())
        assert torch.allclose(with_bonus[advanced], 1000 * without[advanced], rtol=1e-4)
        waiting = ~advanced & ~done
        assert torch.allclose(with_bonus[waiting], without[waiting])
    assert seen > 0


def test_a_late_transition_earns_less_but_never_nothing() -> None:
    dwell = torch.tensor([1.0, 1.0, 1.0, 1.0, 0.0])
    waited = torch.tensor([6.0, 8.0, 12.0, 600.0, 1.0])
    assert reward.promptness(dwell, torch.tensor(6.0), waited).tolist() == [
        1.0,
        0.75,
        0.5,
        0.25,
        1.0,
    ]


def test_a_transitions_bonus_is_multiplied_by_its_promptness() -> None:
    table = load_gait("trot")
    prompt = GaitEnv(table, A1, EnvSettings(envs=64), 0)
    plain = GaitEnv(table, A1, EnvSettings(envs=64, rewards=Rewards(promptness=0.0)), 0)
    late = 0
    for count in range(200):
        action = random_actions(prompt, count)
        before, cycle = prompt.phi.clone(), prompt.command[:, 2].clone()
        _, shared, done, _ = prompt.step(action)
        _, whole, _, _ = plain.step(action)
        advanced = (prompt.phi == 0) & (before > 0) & ~done
        factor = reward.promptness(torch.ones(64), cycle, before + 1) ** 2
        late += int((factor[advanced] < 1).sum())
        assert torch.allclose(shared[advanced], (whole * factor)[advanced], rtol=1e-4)
        assert torch.allclose(shared[~advanced], whole[~advanced])
    assert late > 0


@pytest.mark.parametrize("form", ["exp", "clip"])
def test_rewards_are_never_negative(form: str) -> None:
    env = make(rewards=Rewards(reward_shaping=form))
    for count in range(30):
        assert env.step(3 * random_actions(env, count))[1].min() >= 0


def test_episodes_begin_in_any_state_but_the_sink() -> None:
    env = GaitEnv(load_gait("half_bound"), A1, EnvSettings(envs=64), 0)
    assert set(env.state.tolist()) == {0, 1, 2, 3}
    assert set(make("half_bound", start="first").state.tolist()) == {0}
    assert set(make("half_bound", rewards=Rewards(strict_above_adherence=0.0)).state.tolist()) == {
        0
    }


def test_commands_stay_in_the_gaits_ranges() -> None:
    env = make("walk", seed=4, command_interval=0.1)
    ranges = env.table.commands
    for count in range(30):
        env.step(random_actions(env, count))
        for column, (low, high) in enumerate((ranges.vx, ranges.wz, ranges.frequency)):
            assert low <= env.command[:, column].min() and env.command[:, column].max() <= high


def test_a_robot_whose_physics_fail_is_reset_counted_and_pays_nothing() -> None:
    env = make()
    env.step(torch.zeros(ENVS, 12))
    env.simulation._qvel[3, 0] = np.nan
    groups, rewards, done, _ = env.step(torch.zeros(ENVS, 12))
    assert done[3] and rewards[3] == 0.0
    assert env.failures == 1
    assert all(groups[name].isfinite().all() for name in ("policy", "critic", "estimate"))


def test_an_action_that_is_not_finite_does_no_harm() -> None:
    env = make()
    groups, rewards, _, _ = env.step(torch.full((ENVS, 12), torch.nan))
    assert groups["policy"].isfinite().all() and rewards.isfinite().all()


def test_a_reward_that_is_not_finite_resets_the_robot_and_is_counted() -> None:
    env = make(rewards=Rewards(torque=float("nan")))
    _, rewards, done, _ = env.step(torch.zeros(ENVS, 12))
    assert done.all() and (rewards == 0).all() and env.failures == ENVS


def test_a_robot_on_its_back_ends_its_episode() -> None:
    env = make()
    env.simulation._qpos[2, 3:7] = [0.0, 1.0, 0.0, 0.0]
    _, _, done, extras = env.step(torch.zeros(ENVS, 12))
    assert done[2] and not extras["time_outs"][2]


def test_an_episode_that_lasts_is_a_time_out() -> None:
    env = make(episode=0.1, randomisation=ALIKE)
    for _ in range(4):
        assert not env.step(torch.zeros(ENVS, 12))[2].any()
    _, _, done, extras = env.step(torch.zeros(ENVS, 12))
    assert done.all() and extras["time_outs"].all()


def test_a_reject_edge_ends_the_episode_without_reward() -> None:
    # a rear foot on the ground after the grace period sends Half-Bound into its sink
    low = Terminations(base_height=0.1)
    strict = Rewards(strict_above_adherence=0.0)
    env = make(
        "half_bound", start="first", randomisation=ALIKE, terminations=low, rewards=strict,
        on_violation="end",
    )  # fmt: skip
    for _ in range(40):
        age = env.episode_length_buf.clone()
        _, rewards, done, _ = env.step(torch.zeros(ENVS, 12))
        if done.any():
            assert age[done].min() >= 20 and rewards[done].max() == 0.0
            return
    pytest.fail("a standing robot was never rejected")


@pytest.mark.parametrize(
    "lenient", [{"on_violation": "end"}, {"rewards": Rewards(strict_above_adherence=0.0)}]
)
def test_a_forbidden_contact_may_only_earn_nothing(lenient: dict) -> None:
    """Until the demands are strict, or for good if mistakes do not end episodes."""
    low = Terminations(base_height=0.1)
    env = make("half_bound", start="first", randomisation=ALIKE, terminations=low, **lenient)
    for _ in range(40):
        _, rewards, done, _ = env.step(torch.zeros(ENVS, 12))
    # it stands on all feet, which is forbidden after the grace period
    assert not done.any() and (rewards == 0).all() and (env.state == env.table.start).all()


@pytest.mark.parametrize("on_violation", ["end", "unpaid"])
def test_a_broken_limit_ends_the_episode_or_earns_nothing(on_violation: str) -> None:
    # all robots stand lower than this one allows
    high = Terminations(base_height=1.0)
    strict = Rewards(strict_above_adherence=0.0)
    env = make(on_violation=on_violation, randomisation=ALIKE, terminations=high, rewards=strict)
    for _ in range(20):
        _, rewards, done, extras = env.step(torch.zeros(ENVS, 12))
        assert (done == (on_violation == "end")).all() and not extras["time_outs"].any()
        assert on_violation == "end" or (rewards == 0).all()


def test_a_joint_that_turns_faster_than_the_robots_breaks_a_limit() -> None:
    env = make(randomisation=ALIKE)
    limits, unchanged = env.world.terminations, torch.zeros(ENVS, 12)
    assert not terminations.beyond_limits(env.simulation, limits, unchanged).any()
    env.simulation.joint_velocity[3, 5] = -1.01 * A1.velocity_limit
    beyond = terminations.beyond_limits(env.simulation, limits, unchanged)
    assert beyond.nonzero().tolist() == [[3]]
    papers = paper(TrainSettings()).world.terminations
    assert not terminations.beyond_limits(env.simulation, papers, unchanged).any()


def test_robots_differ_within_the_settings() -> None:
    settings, simulation = TrainSettings().world.randomisation, make().simulation
    trunk, model = simulation._trunk, simulation._model
    varied = simulation._varied
    ranges = {
        "friction": (varied["geom_friction"][:, 0, 0], settings.friction),
        "mass": (varied["body_mass"][:, trunk] - model.body_mass[trunk], settings.added_mass),
        "strength": (varied["actuator_gainprm"][:, 3, 0] / A1.kp, settings.strength),
        "damping": (varied["dof_damping"][:, 6], settings.joint_damping),
        "delay": (varied["actuator_delay"][:, 0], settings.delay),
    }
    for name, (values, (low, high)) in ranges.items():
        assert low <= values.min() < values.max() <= high, name
    shift = varied["body_ipos"][:, trunk] - model.body_ipos[trunk]
    assert 0 < np.abs(shift).max() <= settings.centre_of_mass


@pytest.mark.parametrize("kinds", [(), ("rough",)])
def test_what_is_told_of_placed_robots_and_of_the_others_is_their_state(kinds: tuple) -> None:
    env = make(ground=GroundSettings(kinds=kinds))
    env.step(random_actions(env, 0))
    simulation, placed = env.simulation, torch.tensor([1, 5])
    joints = env._default + 0.1 * random_actions(env, 1)[:2]
    simulation.place(placed, torch.tensor([[0.3, 0.1], [0.0, -0.2]]), joints, torch.ones(2, 6))
    told = {name: getattr(simulation, name).clone() for name in Simulation.__annotations__}
    torch.testing.assert_close(told["joint_position"][placed], joints)
    lowest = told["foot_height"][placed].amin(1)
    assert lowest.abs().max() < 1e-3  # no foot in the ground, one on it
    simulation._read()
    for name, values in told.items():
        assert torch.equal(values, getattr(simulation, name)), name


def test_a_delayed_action_arrives_later() -> None:
    """The same action has moved the joints less when it comes two physics steps late."""
    prompt, late = make(randomisation=ALIKE), make(randomisation=replace(ALIKE, delay=(0.01, 0.01)))
    for env in (prompt, late):
        env.step(torch.full((ENVS, 12), 0.5))
    moved = [(env.simulation.joint_position - env._default).abs().mean() for env in (prompt, late)]
    assert moved[1] < 0.7 * moved[0]


def test_each_robot_is_pushed_at_moments_of_its_own() -> None:
    env = make(randomisation=replace(ALIKE, push_interval=0.4, push_velocity=0.1))
    pushed = torch.zeros(ENVS, 101)

    def note(ids: torch.Tensor, velocity: torch.Tensor) -> None:
        assert velocity.shape == (len(ids), 2) and (velocity.abs() <= 0.1).all()
        pushed[ids, env.episode_length_buf[ids]] = 1

    env.simulation.push = note
    for _ in range(100):
        env.step(torch.zeros(ENVS, env.num_actions))
    assert 50 <= pushed.sum() <= 110  # 80 on average: 16 robots, 2 s, one in 0.4 s
    assert len(pushed.unique(dim=0)) == ENVS


def test_noise_reaches_the_policy_but_not_the_critic() -> None:
    quiet = ObservationNoise(0.0, 0.0, 0.0, 0.0)
    noisy, clean = make(), make(randomisation=Randomisation(noise=quiet))
    first, second = noisy.get_observations(), clean.get_observations()
    size = second["policy"].shape[1]
    assert torch.equal(first["critic"], second["critic"])
    assert torch.equal(second["policy"], second["critic"][:, :size])
    assert not torch.equal(first["policy"], second["policy"])


def test_fixed_commands_outlast_episodes_and_draws() -> None:
    env = make(episode=0.1, command_interval=0.04)
    wanted = torch.rand(ENVS, 3) + torch.tensor([0.0, 0.0, 8.0])
    env.fix_commands(wanted)
    for count in range(20):
        env.step(3 * random_actions(env, count))
        assert torch.equal(env.command, wanted)


def test_a_robots_own_sums_are_a_part_of_all() -> None:
    env = make()
    for count in range(40):
        env.step(random_actions(env, count))
    sums = env.take_metrics()
    one, every = [sums.robot(i).metrics() for i in range(ENVS)], sums.metrics()
    assert sums.robot(3).steps.tolist() == [40.0]
    for name in ("off_spec_contact", "vx_error", "wz_error", "walk_reward"):
        assert np.mean([metrics[name] for metrics in one]) == pytest.approx(every[name], rel=1e-3)
    assert env.take_metrics().steps.sum() == 0


def test_the_same_power_costs_less_the_more_of_the_wanted_speed_is_reached() -> None:
    """... and neither going too slowly nor the wrong way or too fast makes it cheaper."""
    env, settings = make(), Rewards()
    simulation = env.simulation
    simulation.torque, simulation.joint_velocity = torch.ones(ENVS, 12), torch.ones(ENVS, 12)
    command = torch.zeros(ENVS, 3)
    motion = still(command)

    def cost(wanted: float, speed: float) -> float:
        command[:, 0] = wanted
        simulation.base_velocity[:] = torch.tensor([speed, 0.0, 0.0])
        weighted = reward.terms(simulation, motion, settings, FINE, cost_scale=1.0, dt=env.dt)
        return -float(weighted["power"][0])

    assert cost(0.8, 0.8) == pytest.approx(cost(-0.8, -0.8)) == pytest.approx(0.12 / 1.3)
    assert cost(0.8, 0.0) > cost(0.8, 0.4) > cost(0.8, 0.8) == cost(0.8, 1.2)
    assert cost(0.8, -0.4) == cost(0.8, 0.0) == cost(0.0, 0.4)


@pytest.mark.parametrize("cost_scale", [0.2, 1.0, 1.5])
def test_pressure_above_one_narrows_both_tracking_rewards_alike(cost_scale: float) -> None:
    env, settings = make(), Rewards()
    simulation, error = env.simulation, 0.2
    simulation.base_velocity[:], simulation.angular_velocity[:] = 0.0, 0.0
    motion = still(torch.tensor([error, error, 9.0]).expand(ENVS, 3))

    weighted = reward.terms(simulation, motion, settings, FINE, cost_scale, env.dt)

    narrowed = max(1.0, cost_scale) ** 3
    kernels = [np.exp(-(error**2) * narrowed / w) for w in (settings.width, FINE.vx)]
    for name in ("velocity_x", "velocity_yaw"):
        kept = float(weighted[name][0]) / getattr(settings, name)
        assert kept == pytest.approx(np.mean(kernels), rel=1e-5)


def test_the_narrow_kernel_is_as_narrow_as_the_gaits_commands_are() -> None:
    assert pytest.approx((0.04, 0.04)) == FINE
    slow = reward.FineWidths.of(load_gait("walk").commands, Rewards())
    assert slow == pytest.approx((0.01, 0.01))
    nothing = reward.FineWidths.of(Commands((0.0, 0.0), (0.0, 0.0), (6.0, 6.0)), Rewards())
    assert nothing.vx > 0


def test_the_papers_tracking_is_one_kernel() -> None:
    env, settings = make(), paper(TrainSettings()).world.rewards
    env.simulation.base_velocity[:] = torch.tensor([0.5, 0.0, 0.0])
    fine = reward.FineWidths.of(env.table.commands, settings)
    weighted = reward.terms(
        env.simulation, still(torch.zeros(ENVS, 3)), settings, fine, 1.0, env.dt
    )
    assert weighted["velocity_x"].tolist() == pytest.approx([np.exp(-1.0)] * ENVS)


def test_only_what_feet_are_lifted_beyond_the_free_height_costs() -> None:
    env, settings = make(), Rewards(foot_lift=-8.0)
    high = settings.free_lift + torch.tensor([0.02, -0.01, 0.0, 0.03])
    env.simulation.foot_height[:] = high

    weighted = reward.terms(env.simulation, still(env.command), settings, FINE, 1.0, env.dt)

    assert weighted["foot_lift"].tolist() == pytest.approx([-8.0 * 0.05] * ENVS)


def test_a_target_beyond_a_joints_limit_moves_it_as_the_limit_does() -> None:
    """The daemon never sends more than the limit; a policy must not learn to push with more."""
    limit, beyond = make(randomisation=ALIKE), make(randomisation=ALIKE)
    most = torch.tensor(A1.joint_upper, dtype=torch.float32).expand(ENVS, 12)
    for _ in range(5):
        limit.simulation.step(most)
        beyond.simulation.step(most + 0.5)
    found, expected = beyond.simulation.joint_position, limit.simulation.joint_position
    assert torch.allclose(found, expected, atol=1e-5)
