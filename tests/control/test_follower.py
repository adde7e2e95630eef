import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.control.follower import Follower, Situation
from armgate.control.repulsion import Obstacles
from support.follow_rig import approach_starts, dash, still

SETTLED = 4.0  # longest approach to a moving leader, s
NONE = Obstacles()


def after(trace, seconds, period=0.012):
    k = round(seconds / period)
    return np.degrees(trace.angle[k:]), np.abs(trace.distance[k:])


def nowhere(_):
    return NONE


@pytest.mark.daily(3)
@pytest.mark.parametrize("lag", [0.0, 0.03])
@pytest.mark.parametrize("seed", range(3))
def test_tracks_a_leader_at_a_quarter_metre_per_second(loop, leader, seed, lag):
    trace = loop.run(leader.path(seed, 0.25), 9.0, lag=lag)
    angle, distance = after(trace, SETTLED)
    assert angle.max() < 0.15
    assert distance.max() < 2e-3
    assert not any(step.repulsion or step.emergency for step in trace.steps)


@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_tracks_within_the_papers_figures_without_prediction(loop, leader, lag):
    angle, distance = after(loop.run(leader.path(2, 0.25), 9.0, lag=lag, predict=False), SETTLED)
    assert 0.1 < angle.max() < 1.0
    assert distance.max() < 0.02


FOCUS = np.array([2.0, 0.0, 1.0])


@pytest.mark.daily(9)
@pytest.mark.parametrize("case", range(20))
def test_approach_is_monotone_and_settles(loop, fr, case):
    trace = loop.run(still(FOCUS), 3.2, start=approach_starts(fr, 20, FOCUS)[case])
    angle, distance = after(trace, 3.0)
    assert angle.max() < 0.05
    assert distance.max() < 1e-3
    whole = np.degrees(trace.angle)
    assert whole[0] > 30.0
    assert (whole - np.minimum.accumulate(whole)).max() < 0.05


PASSING = [
    [2.054819054, -1.380276656, 2.439880731, -2.428031320, -0.881026199, 1.347481666],
    [2.434385672, -1.305222952, 1.779951224, 1.459748169, 1.144799568, 0.047473144],
]


@pytest.mark.parametrize("start", PASSING)
def test_a_long_null_space_motion_does_not_turn_the_view_back(loop, leader, start):
    """Check two approaches whose angle rose again by 0.24° and 0.12° with a longer chord, for full speed."""
    tool = leader.robot.model.frame(leader.robot.start, leader.robot.tool).t
    angle, distance = after(loop.run(still(tool), 3.0, start=np.array(start)), 0.0)
    assert (angle - np.minimum.accumulate(angle)).max() < 0.01
    assert angle[-80:].max() < 0.01
    assert distance[-80:].max() < 2e-3


@pytest.mark.daily(4)
@pytest.mark.parametrize("link", [5, 9, 13, 18])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_view_is_kept_while_evading(loop, fr, leader, law, link, seed):
    """Check dashes of the leader at a link: bounded accelerations must not turn the view."""
    path = dash(law.spheres.centres(fr.start)[link], seed, 0.5)
    trace = loop.run(still(FOCUS), 6.0, obstacles=lambda t: leader.obstacles(path(t)))
    angle, distance = after(trace, 1.5)
    assert sum(step.repulsion for step in trace.steps) > 50
    assert distance.max() > 0.01
    assert not any(step.emergency for step in trace.steps)
    assert angle.max() < 0.1


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("speed", "lag", "worst", "off"),
    [(0.5, 0.0, 0.2, 5e-3), (1.0, 0.0, 0.5, 10e-3), (0.25, 0.12, 0.3, 20e-3)],
)
def test_prediction_follows_fast_leaders_and_lagging_robots(loop, leader, speed, lag, worst, off):
    ours, without = (loop.run(leader.path(3, speed), 9.0, lag=lag, predict=p) for p in (True, False))
    angle, distance = after(ours, SETTLED)
    assert angle.max() < worst
    assert distance.max() < off
    rms = [np.sqrt((after(trace, SETTLED)[0] ** 2).mean()) for trace in (ours, without)]
    assert rms[0] < rms[1] / 3.0


def test_starting_from_the_measured_position_overshoots_with_lag(loop, fr):
    """Compare (17) as printed with the default, which starts from the setpoint because of this overshoot."""
    start, rise = approach_starts(fr, 2, FOCUS)[1], {}
    for measured in (True, False):
        angle, _ = after(loop.run(still(FOCUS), 4.0, start=start, lag=0.12, measured=measured), 0.0)
        rise[measured] = (angle - np.minimum.accumulate(angle)).max()
        assert angle[-80:].max() < 0.1
    assert rise[False] < 0.05
    assert rise[True] > 2.0


def test_in_real_time_the_velocity_term_follows_the_leader(loop, leader):
    """Check P ṗ of (4): a law that integrates in real time lags by ṗ/(k_p ‖r‖) without this term."""
    path = leader.path(1, 0.25)
    following, trailing = (
        after(loop.run(path, 7.0, real_time=True, predict=predict), SETTLED)[0].max()
        for predict in (True, False)
    )
    assert following < 0.1
    assert trailing > 1.0


@pytest.mark.parametrize("where", ["behind", "in the lens", "out of reach"])
def test_the_follower_converges_to_unusual_targets(loop, fr, where):
    at = fr.model.frame(fr.start, "camera")
    p = {"behind": at.t - at.R[:, 2], "in the lens": at.t, "out of reach": np.array([6.0, 1.0, 1.0])}[where]
    trace = loop.run(still(p), 6.0, obstacles=nowhere)
    angle, distance = after(trace, 5.0)
    assert angle.max() < 1.0
    assert where == "out of reach" or distance.max() < 0.02
    # Targets behind are near the axis of A1: the arm moves around it slowly, away from itself.
    assert where == "behind" or np.ptp(trace.q[-80:], axis=0).max() < 0.05


STRETCHED = np.radians([10.0, -40.0, 8.0, 0.0, 0.0, 0.0])
WRIST_FLAT = np.radians([0.0, -94.0, 108.0, 30.0, 0.0, -30.0])


@pytest.mark.parametrize("start", [STRETCHED, WRIST_FLAT], ids=["arm stretched", "axes 4 and 6 in line"])
def test_starts_at_a_singularity(loop, start):
    trace = loop.run(still([1.9, 0.3, 1.1]), 5.0, start=start, obstacles=nowhere)
    angle, distance = after(trace, 4.0)
    assert angle.max() < 0.05
    assert distance.max() < 2e-3
    whole = np.degrees(trace.angle)
    assert (whole - np.minimum.accumulate(whole)).max() < 0.05


@pytest.mark.daily(3)
@pytest.mark.parametrize("limit", ["lower", "upper"])
@pytest.mark.parametrize("joint", range(6))
def test_leaves_a_joint_limit_without_oscillation(loop, fr, joint, limit):
    start = np.array(fr.start)
    middle, half = 0.5 * (fr.upper + fr.lower), 0.5 * (fr.upper - fr.lower)
    start[joint] = middle[joint] + (0.999 if limit == "upper" else -0.999) * half[joint]
    trace = loop.run(still([2.0, 0.0, 1.0]), 10.0, start=start, obstacles=nowhere)
    angle, _ = after(trace, 9.0)
    assert angle.max() < 0.1
    assert np.ptp(trace.q[-80:], axis=0).max() < 1e-3


def test_the_follower_evades_an_obstacle_and_keeps_the_view(loop, fr, law):
    """Move a sphere towards the elbow; if the arm did not move, the gap would be less than 50 mm."""
    elbow = law.spheres.centres(fr.start)[9]

    def approaching(t):
        return Obstacles(elbow[None] + (0.0, 0.75 - 0.1 * min(t, 5.0), 0.1), np.array([0.1]))

    trace = loop.run(still([2.0, 0.0, 1.0]), 7.0, obstacles=approaching)
    angle, _ = after(trace, 2.0)
    assert any(step.repulsion for step in trace.steps)
    assert min(step.gap for step in trace.steps) > 0.05
    assert angle.max() < 1.0
    left_alone = np.linalg.norm(elbow - approaching(7.0).centres[0]) - 0.1 - law.spheres.radii[9]
    assert left_alone < 0.05


def test_an_obstacle_too_near_starts_the_emergency_mode(loop, fr, law):
    elbow = law.spheres.centres(fr.start)[9]
    touching = Obstacles(elbow[None] + (0.0, 0.22, 0.0), np.array([0.1]))
    trace = loop.run(still([2.0, 0.0, 1.0]), 1.0, obstacles=lambda _: touching)
    assert trace.steps[0].emergency
    assert "emergency" in trace.steps[0].why
    assert trace.steps[-1].gap > trace.steps[0].gap


def test_zoom(loop):
    for wanted in (0.8, 1.2):
        trace = loop.run(still([1.95, 0.2, 1.0]), 4.0, wanted=wanted)
        angle, distance = after(trace, 3.0)
        assert angle.max() < 0.1
        assert distance.max() < 5e-3


def situation(fr, **changes):
    now = Situation(0.0, fr.start, np.zeros(6), fr.start, np.array([2.0, 0.3, 1.0]), 0.0, 1.0, NONE)
    return now._replace(**changes)


@pytest.fixture
def follower(law, bounds):
    return Follower(law, bounds, period=0.012, ahead=0.024)


def test_a_lost_leader_brings_the_follower_to_rest(follower, fr):
    now, whys = situation(fr), []
    for k in range(80):
        time = 0.012 * k
        seen = min(time, 0.2)
        step = follower.step(now._replace(time=time, target_time=seen))
        now = now._replace(setpoint=now.setpoint + step.dq, last=step.dq, q=now.setpoint)
        whys.append(step.why)
    assert "leader" not in whys[10]
    assert "no position of the leader for 0." in whys[-1]
    assert "coming to rest" in whys[-1]
    assert np.abs(now.last).max() < 1e-12


def test_without_a_leader_the_follower_rests_and_reports_it(follower, fr):
    step = follower.step(situation(fr, target=None))
    assert (step.dq == 0.0).all()
    assert step.why.startswith("no position of the leader yet")
    assert step.angle is None
    assert step.focus is None


def test_the_step_contains_the_measured_errors(follower, fr):
    at = fr.model.frame(fr.start, "camera")
    step = follower.step(situation(fr, target=at.t + 1.1 * at.R[:, 2] + 0.0 * at.R[:, 0]))
    assert step.angle == pytest.approx(0.0, abs=1e-7)
    assert step.distance == pytest.approx(0.1)


@pytest.mark.parametrize(
    "wrong",
    [{"setpoint": np.zeros(5)}, {"last": np.full(6, np.nan)}, {"distance": 0.0}, {"time": np.inf}],
)
def test_invalid_parameters_are_refused(follower, fr, wrong):
    with pytest.raises(ValueError, match="expected"):
        follower.step(situation(fr, **wrong))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), min_size=3, max_size=6),
    st.tuples(*[st.floats(-0.99, 0.99)] * 6),
    st.floats(0.2, 3.0),
)
def test_increments_obey_their_bounds_whatever_the_leader_does(fast, bounds, targets, start, wanted):
    """Check any start, with a target and an obstacle that jump through the cell."""
    follower = Follower(fast, bounds, period=0.012, ahead=0.024)
    middle, half = 0.5 * (bounds.upper + bounds.lower), 0.5 * (bounds.upper - bounds.lower)
    setpoint, last = middle + half * np.array(start), np.zeros(6)
    for k in range(4 * len(targets)):
        p = np.array(targets[k // 4])
        ball = Obstacles(p[None] + (0.0, 0.0, 0.4), np.array([0.3]), 0.0)
        now = Situation(0.012 * k, setpoint, last, setpoint, p, 0.012 * k, wanted, ball)
        dq = follower.step(now).dq
        assert np.isfinite(dq).all()
        assert (np.abs(dq) <= bounds.step + 1e-15).all()
        assert (np.abs(dq - last) <= bounds.change + 1e-15).all()
        end = setpoint + (1.0 + bounds.stop(dq)) * dq
        assert ((end <= bounds.upper + 1e-9) & (end >= bounds.lower - 1e-9)).all()
        setpoint, last = setpoint + dq, dq
