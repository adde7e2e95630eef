"""Kernels are compiled only where they are needed, before robots move, and with a notice the first time."""

import os
import socket
import subprocess
import sys
from importlib import import_module

import pytest

from armgate.cell.compilation import NOTICE, announced
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.control.compiled import camera_law
from armgate.protocol import messages as m
from armgate.world import World

KERNELS = (
    "from armgate.cell.compilation import announced, kernel\n"
    "import kernels\n"
    "with announced():\n"
    "    print(kernel(kernels.double)(21), kernel(kernels.triple)(14))\n"
)


def run(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout, done.stderr


def test_the_first_use_prints_one_notice_and_a_later_start_none(tmp_path):
    source = "def double(x):\n    return 2 * x\n\n\ndef triple(x):\n    return 3 * x\n"
    (tmp_path / "kernels.py").write_text(source, encoding="utf-8")
    place = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert run(KERNELS, **place) == ("42 42\n", f"armgate: {NOTICE}\n")
    assert run(KERNELS, **place) == ("42 42\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["serve", "follow"])
def test_a_command_announces_the_compilation_only_at_its_first_start(tmp_path, command):
    """Then both commands fail: the port of serve is in use, and follow finds no daemon."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        options = {
            "serve": ["configs/demo.yaml", "--port", str(taken.getsockname()[1])],
            "follow": ["127.0.0.1:1", "--robot", "FR", "--leader", "GR"],
        }
        for notices in (1, 0):
            done = subprocess.run(
                [sys.executable, "-m", "armgate.apps", command, *options[command]],
                env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
                capture_output=True,
                text=True,
                check=False,
                timeout=500,
            )
            assert done.returncode > 0
            assert done.stderr.count(NOTICE) == notices, done.stderr


def test_without_numba_there_is_no_notice():
    code = (
        "import sys; sys.modules['numba'] = None\n"
        "from armgate.cell.compilation import announced\n"
        "from armgate.control.compiled import prepare as law\n"
        "from armgate.gate import prepare as gate\n"
        "with announced():\n"
        "    law(), gate()\n"
        "print('done')"
    )
    assert run(code) == ("done\n", "")


@pytest.mark.parametrize(
    "modules",
    [
        ("armgate.client",),
        ("armgate.apps.lead.command", "armgate.apps.lead.drive"),
        ("armgate.apps.zoom.command", "armgate.apps.reach.command", "armgate.apps.follow.command"),
        ("armgate.control.law", "armgate.control.compiled", "armgate.control.redundancy"),
        ("armgate.gate", "armgate.world"),
    ],
)
def test_a_process_that_needs_no_kernel_does_not_load_numba(modules):
    """Also not to solve a task by the readable law: only `camera_law` and a gate load it."""
    code = (
        f"import sys, {', '.join(modules)}\nprint([name for name in sys.modules if name.startswith('numba')])"
    )
    assert run(code) == ("[]\n", "")


def compilations(action):
    """Return the numbers of compilations while an action runs."""
    event = import_module("numba.core.event")
    with event.install_recorder("numba:compile") as recorder:
        action()
    return len(recorder.buffer)


@pytest.mark.usefixtures("compiled_gate")
def test_nothing_is_compiled_after_a_world_was_made():
    """Not by decisions, ticks, states, refusals, copies, and faults."""
    world = World.load("configs/demo.yaml", participants=["a"])
    client = world.join("a")
    lease = client.request(m.Acquire(robot="FR"))

    def steps():
        for k in range(150):
            dq = (0.02, -0.03, 0.02, 0.0, 0.0, 0.0) if k % 50 else (1e9, 0.0, 0.0, 0.0, 0.0, 0.0)
            number = world.number
            client.send(m.Command(robot="FR", fence=lease.fence, seq=number, tick=number, dq=dq))
            world.step()
        world.fork().step()

    assert compilations(steps) == 0
    assert {one.outcome for one in client.take(m.Verdict)} >= {"admitted", "limited"}


def test_nothing_is_compiled_after_a_law_was_made():
    world = World.load("configs/demo.yaml", participants=["a"])
    robot = world.cell.robot("FR")
    law = camera_law(RobotModel.from_urdf(robot.urdf, Placement.identity()), "tool0")

    def evaluate():
        law(robot.start, law.goal([2.0, 0.1, 1.0], 1.0))

    assert compilations(evaluate) == 0


def test_a_compilation_is_noticed_by_this_test(tmp_path):
    module = tmp_path / "fresh.py"
    module.write_text("def half(x):\n    return x / 2\n", encoding="utf-8")
    sys.path.insert(0, str(tmp_path))
    try:
        half = import_module("armgate.cell.compilation").kernel(import_module("fresh").half)
    finally:
        sys.path.remove(str(tmp_path))
    notices = []
    with announced(notices.append):
        assert compilations(lambda: half(42.0)) > 0
    assert notices == [NOTICE]
