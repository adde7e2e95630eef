"""RSI link and virtual KRC, run cycle by cycle, without sockets and with injected time."""

from pathlib import Path
from random import Random

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.urdf import read_urdf
from armgate.emulator.krc import PROFILES, Arrival, Context, Controller, Event, EventLog, Mode, read_ethernet
from armgate.emulator.krc.context import Limits
from armgate.emulator.krc.robot.arm import arm_of_cell
from armgate.events import Command, LeaseChange, LinkChange, Reset, Stopped, Tick, Verdict
from armgate.gate import Gate
from armgate.links.rsi.link import RsiLink
from armgate.links.rsi.setup import setup_of
from armgate.world.gate_runner import GateRunner
from support.krcs import LogRecords, krc_file

CONFIGS = Path(__file__).parents[2] / "configs"
KRC = "192.168.1.20"
WIDE = Limits(100000.0)
SEND = ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_EIPos", "DEF_ESPos", "DEF_Delay")
SIX = tuple(f"AK.A{number}" for number in range(1, 7))
NINE = (*SIX, "EK.E1", "EK.E2", "EK.E3")


def cell_text(folder, *, gantry=False, cycle=0.004, file=None, robot="", **link):
    """Write a cell with one KUKA robot on an RSI link; return the path."""
    mode = link.get("mode", "absolute")
    hold = 0 if mode == "relative" else 1
    (folder / "krc.xml").write_text(file or krc_file(SEND, NINE if gantry else SIX, hold=hold))
    start = "[2.5, 0.0, 2.5, 0 deg, -90 deg, 90 deg, 0 deg, 45 deg, 0 deg]"
    start = start if gantry else "[0 deg, -90 deg, 90 deg, 0 deg, 45 deg, 0 deg]"
    travel = "{travel: {x: [1.0, 3.5], y: [-1.5, 1.5], z: [1.9, 3.2]}, mount: {rpy: [0, 180 deg, 0]}}"
    lines = [
        "armgate: 1", "name: one", "robots:", "  R:",
        f"    urdf: {CONFIGS / 'robots' / 'kr16.urdf'}", f"    start: {start}", f"    period: {cycle}",
        f"    lag_window: {4 * cycle}", "    ignore_pairs: [[link_3, link_5], [gantry_bridge, gantry_column]]"
        if gantry else "    ignore_pairs: [[link_3, link_5]]",
    ]  # fmt: skip
    lines += [f"    gantry: {travel}"] if gantry else []
    lines += [robot] if robot else []
    lines += ["    link:", "      kind: rsi", "      ethernet: krc.xml", f"      krc: {link.pop('krc', KRC)}"]
    lines += [f"      {key}: {value}" for key, value in link.items()]
    path = folder / "cell.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


class Rig:
    """Gate, RSI link and virtual KRC; ``cycle`` runs one cycle of all."""

    def __init__(
        self, folder, profile="krc4-rsi3", *, gantry=False, cycle=None, timeout=100, precision=6,
        peer_file=None, ipoc=1000, start="d1", limits=WIDE, monitor=None, krc_mode=None, krc_timeout=None,
        aspos="stands", cell_precision=None,
        **link,
    ):  # fmt: skip
        kind = PROFILES[profile] if cycle is None else PROFILES[profile].in_cycle(cycle)
        self.period, self.time = kind.cycle, 100.0
        link.setdefault("timeout", timeout)
        if cell_precision is not None:
            link["precision"] = cell_precision
        self.cell = build_cell(load_config([cell_text(folder, gantry=gantry, cycle=kind.cycle, **link)]))
        robot = self.cell.robots[0]
        self.notes, self.log = [], LogRecords()
        self.setup = setup_of(self.cell, robot)
        self.link = RsiLink(self.setup, start, self.notes.append)
        mode = Mode(krc_mode or link.get("mode", "absolute"))
        context = Context(
            mode, precision, krc_timeout or timeout, limits, monitor or limits, aspos == "moves"
        )
        text = peer_file or (folder / "krc.xml").read_text()
        self.krc = Controller(
            kind, context, read_ethernet(text.encode()),
            arm_of_cell(robot, read_urdf(robot.urdf)), chance=Random(1), log=EventLog(self.log), ipoc=ipoc,
        )  # fmt: skip
        self.gate = Gate(self.cell, start)
        self.runner = GateRunner(self.gate, {"R": self.link})
        self.source = (KRC, 40000)
        self.events, self.outputs, self.replies, self.waiting = [], [], [], []
        self.telegram = None
        self.seq = self.fence = 0

    # --- time ---------------------------------------------------------------------------------------------

    def cycle(self, *, to_pc=True, to_krc=True, age=0.001, edit=None):
        """Run one cycle: the KRC reads replies and sends, the link replies, the gate receives its events."""
        arrivals, self.waiting = self.waiting, []
        self.telegram = self.krc.cycle(arrivals)
        self.time += self.period
        self.poll()
        if self.telegram is None or not to_pc:
            return None
        data = self.telegram if edit is None else edit(self.telegram)
        return self.deliver(data, to_krc=to_krc, age=age)

    def cycles(self, count, **how):
        for _ in range(count):
            self.cycle(**how)

    def deliver(self, data, *, to_krc=True, age=0.001, source=None):
        answer = self.link.datagram(data, source or self.source, self.time)
        if answer.reply is not None:
            self.replies.append(answer.reply)
            if to_krc:
                self.waiting.append(Arrival(answer.reply, age, None))
        self.feed(answer.events)
        return answer.reply

    def poll(self):
        self.feed(self.link.poll(self.time))

    def feed(self, events):
        for event in events:
            self.events.append(event)
            self.outputs += self.runner.feed(event)

    def operate(self, event):
        assert self.krc.operate(Event(event)) is None
        if event in ("start", "restart"):
            self.source = (KRC, self.source[1] + 1)
            self.waiting = []

    # --- operators and clients ----------------------------------------------------------------------------

    def begin(self):
        """Start the KRC's program, wait for a ready link, and acquire the robot."""
        self.operate("start")
        self.until_ready()
        assert not self.stops, self.stops
        self.take_lease()
        return self

    def until_ready(self, cycles=600):
        """Run cycles until the link is ready: telegrams agree, and the probe proves the KRC's mode."""
        for _ in range(cycles):
            if self.state == "ready":
                return
            self.cycle()
        assert self.state == "ready", (self.notes, self.changes)

    def synchronise(self, cycles=600, **how):
        """Run cycles until the link is neither waiting nor synchronising."""
        for _ in range(cycles):
            self.cycle(**how)
            if self.state not in ("waiting", "synchronising"):
                return

    def take_lease(self):
        self.fence += 1
        self.outputs += self.runner.feed(LeaseChange("R", self.fence))

    def command(self, *dq):
        """Send a command; return its verdict."""
        self.seq += 1
        tick = self.gate.view("R").tick
        (verdict,) = (
            one for one in self.runner.feed(Command("R", self.fence, self.seq, tick, tuple(dq)))
            if isinstance(one, Verdict)
        )  # fmt: skip
        return verdict

    def drive(self, count, *dq, **how):
        """Run cycles with a command of the same increment in each."""
        for _ in range(count):
            self.command(*dq)
            self.cycle(**how)

    def reset(self):
        """Reset all stops as an operator; return True if all resets were accepted."""
        view = self.gate.view("R")
        answers = [one for stop in tuple(view.stops) for one in self.runner.feed(Reset(stop, "operator"))]
        return all(answer.accepted for answer in answers)

    # --- state ---------------------------------------------------------------------------------------------

    @property
    def state(self):
        return self.link.state.value

    @property
    def changes(self):
        return [event for event in self.events if isinstance(event, LinkChange)]

    @property
    def ticks(self):
        return [event for event in self.events if isinstance(event, Tick)]

    @property
    def stops(self):
        return [one for one in self.outputs if isinstance(one, Stopped)]

    @property
    def krc_state(self):
        return self.krc.state.value

    @property
    def krc_setpoint(self):
        """Setpoint of the KRC, rad and m, in the order of the model."""
        shown = self.krc.status()["setpoint"]
        return [shown[axis.name] / axis.shown for axis in self.setup.axes]

    @property
    def quiet(self):
        """True if no robot was stopped and the KRC is running."""
        return not self.stops and self.krc_state == "running"
