"""The environment of a cell: actions, verdicts, saved states, recordings, wrong use."""

import copy
import pickle

import numpy as np
import pytest

from armgate.audit.recorded_cell import recorded_cell
from armgate.audit.replay import replay_recording
from armgate.cell.errors import ConfigError
from armgate.client.program import TickProgram
from armgate.protocol import messages as m
from armgate.recording import Recording
from support.cells import arms_yaml
from support.clients import run

PLANAR = "configs/planar.yaml"
INTO_THE_POST = np.array([1.0, -1.0, -1.0])


def planar(**options):
    from armgate.env import CellEnv

    env = CellEnv(PLANAR, **options)
    env.reset(seed=0)
    return env


def test_actions_are_shares_of_the_largest_increments(env):
    largest = env.cell.robot("A").velocity * env.cell.robot("A").period
    action = np.array([-0.2, 0.0, -0.1, 0.0, 0.0, 0.0])
    for _ in range(15):
        info = env.step(action)[4]
    assert info["outcome"] == "admitted"
    increment = env.episode.arms["A"].increment
    assert increment == pytest.approx(action[:3] * largest, rel=1e-9)
    assert env.episode.arms["B"].increment == pytest.approx(np.zeros(3))


def test_joint_units_are_increments_per_tick(arms):
    from armgate.env import CellEnv

    env = CellEnv(arms, "A", units="joint")
    env.reset(seed=0)
    for _ in range(40):
        env.step(np.array([0.004, 0.0, 0.0]))
    assert env.episode.arms["A"].increment == pytest.approx([0.004, 0.0, 0.0])
    assert env.action_space.high == pytest.approx(env.cell.robot("A").velocity * 0.012, rel=1e-6)


def test_a_step_lasts_one_tick_of_the_slowest_robot_and_commands_each_tick(env):
    before = env.episode.arms
    verdicts = env.episode.step(env._actions, env._actions.wanted(np.full(6, 0.01)))
    after = env.episode.arms
    assert [after[name].tick - before[name].tick for name in "AB"] == [1, 3]
    assert [verdict.robot for verdict in verdicts] == ["A", "B", "B", "B"]


def test_repeat_commands_an_action_at_several_ticks(arms):
    from armgate.env import CellEnv

    env = CellEnv(arms, "A", repeat=5)
    env.reset(seed=0)
    assert env.step(np.zeros(3))[4]["time"] == pytest.approx(5 * 0.012)


def test_refused_and_limited_actions_are_in_the_info_and_visible_to_the_reward():
    seen = []

    def reward(step):
        seen.append(step)
        return -float(step.refused + step.limited)

    env = planar(reward=reward)
    outcomes = set()
    for _ in range(150):
        _, given, terminated, truncated, info = env.step(INTO_THE_POST)
        outcomes.add(info["outcome"])
        assert not terminated
        assert not truncated
        assert info["outcome"] == info["robots"]["P"]["outcome"]
        admitted = info["outcome"] == "admitted"
        assert (given, info["beta"] == 1.0) == ((0.0, True) if admitted else (-1.0, False))
        assert (info["reasons"] == ()) == admitted
        assert info["margin"] > -1e-9
        assert info["clearance"] > 0.009
    assert outcomes >= {"admitted", "refused"}
    assert "clearance" in info["causes"]
    assert seen[-1].action == pytest.approx(INTO_THE_POST)
    assert seen[-1].arms["P"].q == pytest.approx(info["robots"]["P"]["q"])


def test_without_adjustment_the_gate_judges_raw_increments():
    env = planar(within=False)
    info = env.step(np.array([1.0, 0.0, 0.0]))[4]
    assert (info["outcome"], info["causes"]) == ("limited", ("acceleration",))
    assert 0.0 < info["beta"] <= 1.0


@pytest.mark.parametrize(
    ("action", "text"),
    [
        ([np.nan, 0.0, 0.0], r"expected 3 finite numbers"),
        ([np.inf, 0.0, 0.0], r"expected 3 finite numbers"),
        ([0.0, 0.0], r"shape \(2,\); expected \(3,\)"),
        (0.0, r"shape \(\); expected \(3,\)"),
        (None, r"expected"),
        (["1", "0", "0"], r"expected 3 finite numbers"),
        ([1j, 0, 0], r"expected 3 finite numbers"),
        ([10**400, 0, 0], r"expected 3 finite numbers"),
        (np.ma.masked_all(3), r"expected 3 finite numbers"),
        ("go", r"expected 3 finite numbers"),
        ([[1.0, 2.0], [3.0]], r"expected 3 finite numbers"),
    ],
)
def test_an_invalid_action_is_one_error_and_no_time_passes(action, text):
    from armgate.env import ActionError

    env = planar()
    before = env.episode.world.number
    with pytest.raises(ActionError, match=text):
        env.step(action)
    assert env.episode.world.number == before
    assert env.step(np.zeros(3))[4]["outcome"] == "admitted"


def test_actions_beyond_the_space_are_decided_by_the_gate():
    env = planar(within=False)
    info = env.step(np.full(3, 1e6))[4]
    assert info["outcome"] == "limited"
    assert (np.abs(env.episode.arms["P"].increment) < env.cell.robot("P").velocity * 0.012).all()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"robots": "X"}, "no robot X in cell planar; it has P"),
        ({"robots": ["P", "P"]}, "each once"),
        ({"robots": []}, "at least one robot"),
        ({"robots": "P", "programs": {"P": TickProgram}}, "P: commanded by the agent and by a program"),
        ({"programs": {"P": TickProgram}}, "at least one robot without a program"),
        ({"units": "degrees"}, "units 'degrees'; expected 'share' or 'joint'"),
        ({"observation": "image"}, "observation 'image'; expected 'flat' or 'dict'"),
        ({"repeat": 0}, "repeat: 0; expected 1 to 10000"),
        ({"repeat": 1.5}, "repeat: 1.5; expected 1 to 10000"),
        ({"places": 0}, "places: 0; expected 1"),
        ({"spread": float("nan")}, "spread: nan; expected 0"),
        ({"render_mode": "rgb_array"}, "render_mode 'rgb_array'; expected None"),
    ],
)
def test_wrong_arguments_are_one_error(options, text):
    from armgate.env import CellEnv, EnvError

    with pytest.raises(EnvError, match=text):
        CellEnv(PLANAR, **options)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"place": 32}, "place.: 32; expected 0 to 31"),
        ({"place": True}, "place.: True; expected 0 to 31"),
        ({"state": b"x"}, "state.: not a saved episode"),
        ({"state": pickle.dumps((1, 2, 3, 4, 5))}, "state.: not a saved episode: a int"),
        ([1], "reset options: .1.; expected a mapping"),
        ({"place": "first"}, "place.: 'first'; expected 0 to 31"),
        ({"state": "saved"}, "state.: a str; expected bytes from save"),
        ({"state": b"", "place": 1}, "expected no other option beside 'state'"),
        ({"goal": [0, 0, 0]}, "reset has no option 'goal'; expected place, state"),
    ],
)
def test_wrong_options_of_reset_are_one_error(options, text):
    from armgate.env import EnvError

    with pytest.raises(EnvError, match=text):
        planar().reset(options=options)


class Wave(TickProgram):
    """Program that moves the first joint back and forth."""

    def __init__(self, context):
        self.count = 0

    def step(self, tick):
        self.count += 1
        return [0.001 * (1 if self.count % 40 < 20 else -1), 0.0, 0.0] if self.count < 50 else None


def test_programs_command_other_robots_until_they_end(arms):
    from armgate.env import CellEnv

    env = CellEnv(arms, "B", programs={"A": Wave})
    env.reset(seed=0)
    places = []
    for _ in range(300):
        observation, _, _, _, info = env.step(np.zeros(3))
        places.append(env.episode.arms["A"].setpoint[0])
    assert max(places) > 0.01
    assert info["programs"] == {"A": "ended"}
    assert len(set(places[-30:])) == 1
    assert observation.shape == (3 + 3 + 3 + 1 + 3,)
    env.reset()
    assert env.episode.arms["A"].setpoint[0] == 0.0


def continued(env, steps=40):
    random = np.random.default_rng(1)
    shape = env.action_space.shape
    return [env.step(random.uniform(-0.3, 0.3, shape))[0].tolist() for _ in range(steps)]


def test_a_saved_episode_continues_the_same_also_in_another_environment(arms):
    from armgate.env import CellEnv

    env = CellEnv(arms, "B", programs={"A": Wave})
    env.reset(seed=0)
    continued(env, 20)
    state = env.save()
    wanted = continued(env)
    other = CellEnv(arms, "B", programs={"A": Wave})
    for again in (env, other):
        again.reset(options={"state": state})
        assert continued(again) == wanted


def test_a_state_of_an_agent_with_other_robots_is_refused(env, arms):
    from armgate.env import CellEnv, EnvError

    with pytest.raises(EnvError, match="the agent commanded A, B in another environment"):
        CellEnv(arms, "A").reset(options={"state": env.save()})


def test_a_state_of_another_task_is_refused(arms):
    from armgate.env import CellEnv, EnvError, Reach

    free, reach = CellEnv(arms), CellEnv(arms, task=Reach())
    free.reset(seed=0)
    with pytest.raises(EnvError, match="saved with the task Free; this environment has Reach"):
        reach.reset(options={"state": free.save()})


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_of_an_environment_continues_with_the_same_bytes(env, copied):
    action = np.full(6, 0.3)
    env.step(action)
    again = copied(env)
    for _ in range(3):
        assert repr(env.step(action)) == repr(again.step(action))


def test_a_recording_environment_cannot_be_copied_and_a_closed_one_needs_a_reset(tmp_path):
    import gymnasium

    from armgate.env import EnvError

    env = planar(record=tmp_path)
    with pytest.raises(EnvError, match="records cannot be copied"):
        copy.deepcopy(env)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))
    env.reset()
    assert env.step(np.zeros(3))[4]["outcome"] == "admitted"
    env.close()


def test_a_state_of_another_cell_is_refused(env, tmp_path):
    from armgate.env import CellEnv
    from armgate.world import SavedWorldError

    file = tmp_path / "other.yaml"
    file.write_text(arms_yaml(periods=(0.012, 0.004), lag=0.02))
    with pytest.raises(SavedWorldError, match="its cell is"):
        CellEnv(file).reset(options={"state": env.save()})


def test_a_step_before_the_first_reset_is_one_error(arms):
    import gymnasium

    from armgate.env import CellEnv

    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        CellEnv(arms).step(np.zeros(6))


def test_a_robot_with_a_clock_of_its_own_is_an_error_at_once():
    from armgate.env import CellEnv

    with pytest.raises(ConfigError, match=r"rsi-virtual.yaml:\d+: .*has a clock of its own"):
        CellEnv(["configs/demo.yaml", "configs/links/rsi-virtual.yaml"])


def test_without_gymnasium_the_error_names_the_command_that_installs_it(monkeypatch):
    import sys

    for name in [name for name in sys.modules if name.startswith("armgate.env")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(ModuleNotFoundError, match=r"gymnasium is not installed; .*pip install '\.\[env\]'"):
        import armgate.env  # noqa: F401


def test_an_episode_ends_if_a_robot_is_stopped():
    env = planar()
    env.episode.world.join("guard", "observer").send(m.Stop(reason="enough"))
    _, _, terminated, _, info = env.step(np.zeros(3))
    assert terminated
    assert info["outcome"] == "refused"


async def test_recorded_episodes_replay_bit_for_bit(tmp_path):
    env = planar(record=tmp_path / "runs", random_start=True, places=3)
    for place in (1, 0):
        env.reset(options={"place": place})
        continued(env, 30)
    env.close()
    env.close()
    first, second, third = sorted((tmp_path / "runs").iterdir())
    for folder in (second, third):
        recording = Recording.open(folder)
        assert replay_recording(recording, recorded_cell(recording.header)).count == 0
    status, text, err = await run("replay", second)
    assert (status, err) == (0, "")
    assert "have the same outputs, bit for bit" in text
    assert [first.name, third.name] == ["episode-000001", "episode-000003"]


def test_recorded_episodes_are_the_same_as_others(tmp_path):
    plain, recorded = planar(places=3), planar(places=3, record=tmp_path)
    for env in (plain, recorded):
        env.reset(options={"place": 2})
    assert continued(plain) == continued(recorded)
    recorded.close()


def test_an_episode_at_a_saved_state_is_not_recorded(tmp_path):
    from armgate.env import EnvError

    env = planar(record=tmp_path)
    with pytest.raises(EnvError, match="cannot be recorded"):
        env.reset(options={"state": env.save()})
    env.close()
