"""Gate with planted faults, driven toward goals, and the monitor that checks its states.

The gate has its own configuration, so that a fault can be planted into its model; the monitor reads the true
one. Links are the emulated ones of the daemon.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armgate import events as e
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config
from armgate.daemon.recording.recorder import Recorder
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from armgate.monitor.findings import Finding
from armgate.monitor.model import build
from armgate.monitor.monitor import Monitor
from armgate.monitor.tick_state import state_of_entry
from armgate.monitor.yaml_files import read_files
from armgate.protocol import messages as m
from armgate.recorder.header import header_of
from armgate.world import to_protocol
from armgate.world.gate_runner import GateRunner
from armgate.world.states import Snapshot

CONFIGS = Path(__file__).parents[2] / "configs"
ARM, GANTRY = "FR", "GR"
FULL = 1.0

Tree = dict[str, Any]
Change = Callable[[Tree], None]


def demo(*robots: str, surroundings: Sequence[str] = ("floor", "frame_beam_front", "pipe_feed")) -> Tree:
    """Return the demo cell with some robots and surroundings only, with absolute paths of files."""
    tree = yaml.safe_load((CONFIGS / "demo.yaml").read_text())
    tree["robots"] = {name: own for name, own in tree["robots"].items() if name in robots}
    tree["surroundings"] = {n: own for n, own in tree["surroundings"].items() if n in surroundings}
    for own in tree["robots"].values():
        own["urdf"] = str(CONFIGS / own["urdf"])
        own["ignore_pairs"] = [
            p for p in own["ignore_pairs"] if p[1] not in ("floor",) or "floor" in surroundings
        ]
    return tree


def saved(tree: Tree, file: Path) -> Path:
    file.write_text(yaml.safe_dump(tree, sort_keys=False))
    return file


class Watched:
    """Gate with its links, and a monitor.

    Args:
        tree: The true configuration.
        folder: Folder for files.
        wrong: Changes the configuration of the gate.
        wrong_cell: Changes the cell of the gate.
        start: Positions by robot; as configured for others.
        tamper: Changes plans on their way to the links.
        recorder: Records the run.
    """

    def __init__(
        self,
        tree: Tree,
        folder: Path,
        wrong: Change | None = None,
        start: Mapping[str, Sequence[float]] | None = None,
        wrong_cell: Callable[[Cell], Cell] | None = None,
        tamper: Callable[[e.Plan], e.Plan] | None = None,
        recorder: Recorder | None = None,
        lag: float = 0.03,
    ) -> None:
        true = saved(tree, folder / "true.yaml")
        given = copy.deepcopy(tree)
        if wrong is not None:
            wrong(given)
        self.cell = build_cell(load_config([true]))
        gate_cell = build_cell(load_config([saved(given, folder / "given.yaml")]))
        self.monitor = Monitor(build(read_files([true])))
        self.findings: list[Finding] = []
        self.gate = Gate(wrong_cell(gate_cell) if wrong_cell else gate_cell, "x", compiled=False)
        start = start or {}
        self.links = {
            r.name: EmulatedLink(r.name, "x", list(start.get(r.name, r.start)), r.period, lag)
            for r in self.cell.robots
        }
        carriers = {name: Tampered(link, tamper) if tamper else link for name, link in self.links.items()}
        self.time, self.tick, self.recorder = 0.0, -1, recorder
        self.beat = 0.012  # time between ticks; the period of the configuration unless a test changes it
        if recorder is not None:
            recorder.begin(header_of(gate_cell, "x", False, 0.0, compiled=False), lambda: self.time)
        self.runner = GateRunner(self.gate, carriers, recorder.tap if recorder is not None else None)
        self.noise: Callable[[str, e.Joints], e.Joints] | None = None
        self.falsify: Callable[[m.Entry], m.Entry] | None = None
        self.verdicts: list[e.Verdict] = []
        for fence, name in enumerate(self.links, start=1):
            self.runner.feed(e.LinkChange(name, e.LinkState.READY))
            self.runner.feed(e.LeaseChange(name, fence))

    def instant(self) -> list[Finding]:
        """Let all robots tick once, and check their states."""
        self.tick += 1
        self.time = self.tick * self.beat
        ticks = [self._measured(link.advance(self.time)) for link in self.links.values()]
        for tick in ticks:
            self.runner.feed(tick)
        new = []
        samples = [state_of_entry(entry) for entry in self._record(ticks)]
        for sample in samples:
            new += self.monitor.check(sample, [other for other in samples if other is not sample])
        self.findings += new
        return new

    def change_link(self, name: str, state: e.LinkState) -> None:
        """Change the state of a link between two ticks; all robots are recorded again, as by the daemon."""
        self.runner.feed(e.LinkChange(name, state))
        self._record(self.shown.ticks)

    def _record(self, ticks: Sequence[e.Tick]) -> tuple[m.Entry, ...]:
        """Record the robots as they are now, and return their entries."""
        entries = tuple(to_protocol.entry(name, self.runner.view(name), None) for name in self.links)
        if self.falsify is not None:
            entries = tuple(map(self.falsify, entries))
        self.shown = Snapshot(ticks, entries, {}, ())
        if self.recorder is not None:
            self.recorder.show(self.shown)
        return entries

    def _measured(self, tick: e.Tick) -> e.Tick:
        if self.noise is None:
            return tick
        return replace(tick, q=self.noise(tick.robot, tick.q))

    def command(self, name: str, dq: Sequence[float]) -> e.Verdict:
        fence = list(self.links).index(name) + 1
        told = self.runner.feed(e.Command(name, fence, self.tick, self.tick, tuple(map(float, dq))))
        (verdict,) = (one for one in told if isinstance(one, e.Verdict))
        self.verdicts.append(verdict)
        return verdict

    def toward(self, goals: Mapping[str, Sequence[float]], ticks: int, speed: float = FULL) -> list[Finding]:
        """Drive robots to goals at a share of their speed until there is a finding."""
        for _ in range(ticks):
            self.instant()
            if self.findings:
                break
            for name, goal in goals.items():
                robot = self.cell.robot(name)
                way = np.array(goal) - np.array(self.runner.view(name).setpoint)
                full = robot.velocity * robot.period * speed
                self.command(name, way / max(1.0, float(np.max(np.abs(way) / full))))
        return self.findings

    def stop_and_reset(self, *robots: str) -> bool:
        """Stop robots, reset the stop at once and renew leases; return True if the reset was accepted."""
        names = robots or tuple(self.links)
        (stopped,) = (o for o in self.runner.feed(e.Stop(names, "test", "t")) if isinstance(o, e.Stopped))
        self.instant()
        told = self.runner.feed(e.Reset(stopped.id, "t"))
        return any(isinstance(one, e.ResetAnswer) and one.accepted for one in told)

    def rest(self, ticks: int) -> list[Finding]:
        for _ in range(ticks):
            self.instant()
        return self.findings


class Tampered:
    """Link that receives other plans than the gate made."""

    def __init__(self, link: EmulatedLink, tamper: Callable[[e.Plan], e.Plan]) -> None:
        self._link, self._tamper = link, tamper

    def offer(self, plan: e.Plan) -> e.PlanAnswer:
        answer = self._link.offer(self._tamper(plan))
        return e.PlanAnswer(answer.robot, plan.key, answer.accepted, answer.reason)

    def rebase(self, rebase: e.Rebase) -> None:
        self._link.rebase(rebase)
