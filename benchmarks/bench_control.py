"""Cost of the camera law, in units of one step of the QP-based IK library pink on the same arm.

The step of pink is a 6-D frame task and a posture task under joint limits: model update, QP, integration.
All cases are measured in alternation in one process, with as many calls in a row as a tick may make, so that
a disturbance affects all of them. The result is the ratio.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter_ns

import numpy as np
import pink
from pink.tasks import FrameTask, PostureTask
from report import Row, report

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.control.compiled import CompiledLaw
from armgate.control.law import CameraLaw
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres

DEMO = Path(__file__).parents[1] / "configs" / "demo.yaml"
ROUNDS = int(sys.argv[1]) if len(sys.argv) > 1 else 100
ROW = 48  # calls in a row, the largest number of evaluations in a tick
STEP = 0.05  # step of the Runge-Kutta method, s

GOALS = {"f, numpy": 0.6, "RK4 step, numpy": 2.2, "f, numba": 0.03, "RK4 step, numba": 0.06}


def pink_step(robot, q: np.ndarray, target: np.ndarray) -> Callable[[], object]:
    """Step towards a pose of the camera."""
    configuration = pink.Configuration(robot.model.pin_model, robot.model.pin_model.createData(), q)
    task, posture = FrameTask("camera", position_cost=1.0, orientation_cost=1.0), PostureTask(cost=1e-3)
    posture.set_target(q)
    goal = configuration.get_transform_frame_to_world("camera").copy()
    goal.translation += target
    task.set_target(goal)

    def step() -> None:
        configuration.update(q)
        velocity = pink.solve_ik(configuration, [task, posture], robot.period, solver="daqp")
        configuration.integrate(velocity, robot.period)

    return step


def cases() -> dict[str, Callable[[], object]]:
    """Return the demo's follower near its target, with the leader's spheres and the floor out of reach."""
    cell = build_cell(load_config([DEMO]))
    robot, leader = cell.robot("FR"), cell.robot("GR")
    spheres = Spheres.of(leader.model)
    obstacles = Obstacles(spheres.centres(leader.start), spheres.radii, 0.0)
    q, p = np.array(robot.start), (2.0, 0.1, 1.05)
    law, fast = CameraLaw(robot.model, "camera"), CompiledLaw(robot.model, "camera")
    goal, packed = law.goal(p, 1.0, law.scene(obstacles, q)), fast.goal(p, 1.0, fast.scene(obstacles, q))
    return {
        "pink": pink_step(robot, q, np.array([0.01, 0.01, 0.01])),
        "f, numpy": lambda: law(q, goal),
        "RK4 step, numpy": lambda: law.step(q, STEP, goal),
        "f, numba": lambda: fast(q, packed),
        "RK4 step, numba": lambda: fast.step(q, STEP, packed),
    }


def measure(functions: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return medians, µs."""
    times: dict[str, list[int]] = {name: [] for name in functions}
    for _ in range(ROUNDS):
        for name, function in functions.items():
            begin = perf_counter_ns()
            for _ in range(ROW):
                function()
            times[name].append(perf_counter_ns() - begin)
    return {name: median(values) / ROW / 1e3 for name, values in times.items()}


def main() -> None:
    functions = cases()
    for function in functions.values():
        function()
    figures = measure(functions)
    unit = figures["pink"]
    rows = [Row("one step of pink", unit, "µs")]
    for name, goal in GOALS.items():
        rows += [Row(name, figures[name], "µs"), Row(name, figures[name] / unit, "pink steps", goal)]
    report("control", rows)


if __name__ == "__main__":
    main()
