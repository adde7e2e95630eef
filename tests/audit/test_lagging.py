"""``armgate lag``: simulated drives, a virtual KRC whose axes have different lags, and the command."""

import math
import random

import pytest

from armgate.audit.lag import measure_lags
from armgate.cell.cell import build_cell
from armgate.events import Tick
from gate import scenes
from support.cells import arms_config
from support.clients import run
from support.gate_runs import record_run
from support.rsi import Rig

LAGS = (0.033, 0.027, 0.030, 0.0285)


def ticks(lags, delay, tolerance=0.0, seed=1, count=600, period=0.004):
    """Return the ticks of a robot that swings its joints at different rates, measured with noise."""
    rng, out = random.Random(seed), []
    setpoints = [[0.0] * len(lags)] * (delay + 1)
    q = [0.0] * len(lags)
    for k in range(count):
        noisy = tuple(x + rng.uniform(-tolerance, tolerance) for x in q)
        u = tuple(0.004 * math.sin(0.03 * (j + 1) * k) for j in range(len(lags)))
        setpoints.append([s + d for s, d in zip(setpoints[-1], u, strict=True)])
        out.append(Tick("A", k, period * k, noisy, tuple(setpoints[-1]), u))
        for j, lag in enumerate(lags):
            q[j] += (1 - math.exp(-period / lag)) * (setpoints[-1 - delay][j] - q[j])
    return out


@pytest.mark.parametrize("delay", [0, 1, 4])
@pytest.mark.parametrize("tolerance", [0.0, 1e-5])
def test_lags_and_delay_of_a_simulated_robot_are_measured(delay, tolerance):
    found = measure_lags(scenes.duel(), "A", ticks(LAGS, delay, tolerance))
    assert found.delay == delay
    assert list(found.lags.values()) == pytest.approx(LAGS, rel=0.002)
    assert found.difference == pytest.approx(0.006, rel=0.02)
    assert (found.lag, found.proposed) == pytest.approx((0.03, 0.009), rel=0.02)
    assert max(found.errors.values()) <= max(1.5 * tolerance, 2e-5)
    assert found.still == ()


def test_a_minimal_difference_is_proposed_for_equal_lags():
    assert measure_lags(scenes.duel(), "A", ticks((0.03,) * 4, 1)).proposed == pytest.approx(9e-4, rel=0.01)


def test_joints_at_rest_are_listed_and_a_robot_at_rest_is_not_measured():
    cell = scenes.duel()
    given = ticks(LAGS, 1)
    name = cell.robots[0].model.joints[1].name
    stuck = [
        Tick("A", t.tick, t.time, (t.q[0], 0.0, *t.q[2:]), (t.setpoint[0], 0.0, *t.setpoint[2:]), t.increment)
        for t in given
    ]
    found = measure_lags(cell, "A", stuck)
    assert found.still == (name,)
    assert name not in found.lags
    assert measure_lags(cell, "B", given) is None
    assert measure_lags(cell, "A", given[:40]) is None  # too short


def test_different_lags_of_a_virtual_krc_are_measured_from_its_telegrams(tmp_path, monkeypatch):
    """Telegrams have four decimals, in the fastest cycle; the lags are measured from the link's ticks."""
    from armgate.emulator.krc.process.options import select_profile
    from support import rsi

    lags = {"A1": 33.0, "A2": 27.0, "A3": 30.0, "A4": 31.0, "A5": 29.0, "A6": 30.0}
    text = ",".join(f"{axis}={lag}" for axis, lag in lags.items())
    monkeypatch.setattr(rsi, "PROFILES", {"krc4-rsi3": select_profile("krc4-rsi3", None, text)})
    rig = Rig(tmp_path, "krc4-rsi3", precision=4).begin()
    for k in range(8):
        sign = 1.0 if k % 2 else -1.0
        rig.drive(60, *(sign * x for x in (0.0012, -0.0006, 0.0006, 0.001, -0.001, 0.001)))
        rig.cycles(40)
    seen = [event for event in rig.events if isinstance(event, Tick)]
    found = measure_lags(rig.cell, "R", seen)
    assert found.delay == 1
    assert list(found.lags.values()) == pytest.approx([lag / 1000 for lag in lags.values()], rel=0.01)


def swing(k):
    return {"A": (0.004 * math.sin(0.1 * k), 0.003 * math.sin(0.07 * k), -0.004 * math.sin(0.05 * k))}


def recorded(folder, lag, **robot):
    config = arms_config(folder, lag=0.03)
    config.robots.update({"A": config.robots["A"].model_copy(update=robot)})
    record_run(build_cell(config), folder / "run", 200, swing, lag=lag)


@pytest.mark.slow
async def test_the_command_proposes_values(tmp_path):
    recorded(tmp_path, 0.03)
    status, text, err = await run("lag", tmp_path / "run")
    assert (status, err) == (0, "")
    assert "J1: lag 30.0" in text
    assert "lag_difference: 0.90 ms" in text
    assert "link: {lag: 30.0 ms}" in text
    status, _, err = await run("lag", tmp_path / "run", "--robot", "C")
    assert (status, "the recording has A, B" in err) == (2, True)


@pytest.mark.slow
async def test_the_command_fails_if_the_declared_difference_is_too_small(tmp_path):
    recorded(tmp_path, (0.03, 0.0285, 0.0315), lag_difference=0.0029)
    status, text, err = await run("lag", tmp_path / "run", "--robot", "A")
    assert status == 1
    assert "lags differ by 3.0" in text
    assert "lag_difference is 2.90 ms, less than the 3.0" in err
    recorded_again = tmp_path / "again"
    recorded_again.mkdir()
    recorded(recorded_again, (0.03, 0.0285, 0.0315), lag_difference=0.0031)
    assert (await run("lag", recorded_again / "run", "--robot", "A"))[0] == 0
