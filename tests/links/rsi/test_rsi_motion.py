"""Corrections keep speed and acceleration limits in every cycle, in both modes, in all profiles."""

import random
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from support.krcs import values_of
from support.rsi import Rig

EXACT = 2e-6
"""Rounding to six decimals, deg and mm, twice."""


class Bounds:
    """Comparison of the KRC's drive setpoints with the cell's bounds, deg and mm; without held cycles."""

    def __init__(self, rig):
        self.rig, self.last, self.step = rig, rig.krc_setpoint, [0.0] * len(rig.setup.axes)
        robot, period = rig.cell.robots[0], rig.period
        self.speed = robot.velocity * period
        self.change = [
            max(a, d) * period**2 for a, d in zip(robot.acceleration, robot.deceleration, strict=True)
        ]

    def update(self, held=False):
        now = self.rig.krc_setpoint
        step = [a - b for a, b in zip(now, self.last, strict=True)]
        for j, axis in enumerate(self.rig.setup.axes):
            slack = EXACT / axis.shown
            assert abs(step[j]) <= self.speed[j] + slack
            assert held or abs(step[j] - self.step[j]) <= self.change[j] + 2 * slack
        self.last, self.step = now, step


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("profile", "gantry", "mode"),
    [
        ("krc4-rsi3", False, "absolute"),
        ("krc4-rsi3", True, "relative"),
        ("krc2-rsi2", True, "absolute"),
        ("krc5-rsi5", False, "relative"),
    ],
)
def test_full_speed_in_changing_directions_never_faults_a_drive(tmp_path, profile, gantry, mode):
    more = {}
    if profile == "krc2-rsi2":
        more["axes"] = "{" + ", ".join(
            f"E{n}: {{joint: {j}, received: 57.29577951308232}}" for n, j in enumerate("XYZ", start=1)
        ) + "}"  # fmt: skip
    rig = Rig(tmp_path, profile, gantry=gantry, mode=mode, **more).begin()
    chance, bounds = random.Random(5), Bounds(rig)
    dq = [0.0] * len(rig.setup.axes)
    for number in range(300):
        if number % 25 == 0:
            dq = [chance.uniform(-1.5, 1.5) * v * rig.period for v in rig.cell.robots[0].velocity]
        rig.command(*dq)
        rig.cycle()
        bounds.update()
    rig.cycles(120)
    assert rig.quiet
    assert rig.krc.status()["delay"] == 0
    start = rig.cell.robots[0].start
    assert max(abs(a - b) for a, b in zip(start, rig.krc_setpoint, strict=True)) > 0.1
    gaps = zip(rig.gate.view("R").setpoint, rig.krc_setpoint, strict=True)
    assert max(abs(a - b) for a, b in gaps) < 1e-7


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(
        st.sampled_from(["", "", "", "", "", "", "pc", "krc", "late", "twice"]), min_size=40, max_size=80
    ),
    st.sampled_from(["absolute", "relative"]),
    st.randoms(use_true_random=False),
)
def test_after_any_loss_delay_or_repetition_link_and_krc_have_the_same_setpoint(
    tmp_path_factory, fates, mode, chance
):
    rig = Rig(tmp_path_factory.mktemp("rsi"), mode=mode, late_in_a_row=100).begin()
    bounds = Bounds(rig)
    dq = (0.0015, -0.0008, 0.0008, 0.0, 0.001, 0.0)
    for fate in fates:
        if chance.random() < 0.1:
            dq = tuple(-u for u in dq)
        rig.command(*dq)
        before = rig.krc.status()["delay"]
        rig.cycle(to_pc=fate != "pc", to_krc=fate != "krc", age=0.01 if fate == "late" else 0.001)
        if fate == "twice":
            rig.deliver(rig.telegram)
        # In a cycle that the KRC holds, and in the next one, the KRC itself causes a step.
        bounds.update(held=rig.krc.status()["delay"] > before or rig.ticks[-1].rebased)
    rig.cycles(60)
    assert rig.krc_state == "running"
    assert rig.state == "ready"
    assert not rig.stops
    gaps = zip(rig.gate.view("R").setpoint, rig.krc_setpoint, strict=True)
    assert max(abs(a - b) for a, b in gaps) < 1e-7


def test_a_simulator_with_instantaneous_joints_and_numbers_from_zero(tmp_path):
    """A KRC like public simulators of robots: RIst is all zero, the root differs, joints follow at once."""
    rig = Rig(tmp_path, ipoc=0)
    place = [[0.0] * 6]

    def edit(data):
        held = [p + o for p, o in zip(values_of(data, "ASPos"), place[-1], strict=True)]
        axes = " ".join(f'A{number}="{value}"' for number, value in enumerate(held, start=1))
        data = re.sub(rb"<AIPos [^>]*/>", f"<AIPos {axes}/>".encode(), data)
        data = re.sub(rb'(?<=[XYZABC]=")[^"]*', b"0.0", data)
        data = re.sub(rb"<E[IS]Pos [^>]*/>", b"", data)
        return data.replace(b'<Rob Type="KUKA">', b'<Rob TYPE="KUKA">')

    def follow():
        place.append(values_of(rig.replies[-1], "AK"))

    rig.operate("start")
    for _ in range(200):
        rig.cycle(edit=edit)
        follow()
    assert rig.state == "ready", rig.changes
    rig.take_lease()
    for _ in range(60):
        assert rig.command(0.004, 0.0, 0.0, 0.0, 0.0, 0.0).outcome != "refused"
        rig.cycle(edit=edit)
        follow()
    for _ in range(60):
        rig.cycle(edit=edit)
        follow()
    assert rig.quiet
    assert place[-1][0] > 10.0
