"""Check of the setpoints of a virtual KRC's drives, cycle by cycle, against the bounds of the cell."""

import csv
from itertools import pairwise

from armgate.cell.urdf import read_urdf
from armgate.emulator.krc.robot.arm import arm_of_cell

EXACT = 2e-6
"""Tolerance for two roundings to six decimals, deg and mm."""


def check_setpoints(trace, robot):
    """Check a trace (``armgate krc --trace``) of a robot of a cell.

    Speed and acceleration must be within the cell's bounds in every cycle of every run. A cycle without a
    reply is an exception: the KRC holds the robot, which then starts from rest.

    Returns:
        Number of cycles in which the robot moved, and number of cycles in which it was held.
    """
    axes = {axis.name: axis for axis in arm_of_cell(robot, read_urdf(robot.urdf)).axes}
    with trace.open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert rows
    moved = held = 0
    before = dict.fromkeys(axes, 0.0)
    for old, new in pairwise(rows):
        if new["run"] != old["run"] or new["cycle"] != old["cycle"] + 1:
            before = dict.fromkeys(axes, 0.0)
            continue
        late = new["delay"] > old["delay"]
        step = {name: new[name] - old[name] for name in axes}
        for name, axis in axes.items():
            where = f"{name} in cycle {new['cycle']:.0f}"
            change = step[name] - before[name]
            assert abs(step[name]) <= axis.speed * robot.period + EXACT, where
            if late:
                assert step[name] == 0.0, where
            else:
                assert abs(change) <= axis.acceleration * robot.period**2 + 2 * EXACT, where
        moved += any(step.values())
        held += late
        before = step
    return moved, held
