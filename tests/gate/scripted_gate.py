"""Gate whose events a test writes one by one."""

from armgate.events import Command, LeaseChange, LinkChange, LinkState, PlanAnswer, Tick
from armgate.gate import Gate
from gate import scenes

T = 0.004
STEP = 5e-5


class ScriptedGate:
    """Gate whose links are controlled by the test: no lag, and no losses unless the test makes them."""

    def __init__(self, cell, start=None, gate=None):
        self.gate, self.cell = gate or Gate(cell, "s"), cell
        self.names = [r.name for r in cell.robots]
        self.q = [tuple(map(float, r.start)) for r in cell.robots] if start is None else list(start)
        self.tick, self.held = [-1] * len(self.q), [None] * len(self.q)
        self.seq = 0
        for i, name in enumerate(self.names):
            self.rest(i)
            self.gate.step(LinkChange(name, LinkState.READY))
            self.gate.step(LeaseChange(name, 1))

    def view(self, i=0):
        return self.gate.view(self.names[i])

    def rest(self, i=0, q=None, count=1):
        """Send ticks without a plan, with the robot measured at ``q``."""
        out = []
        for _ in range(count):
            self.tick[i] += 1
            u = (0.0,) * len(self.q[i])
            at = self.q[i] if q is None else q
            now = self.tick[i] * self.cell.robots[i].period
            out += self.gate.step(Tick(self.names[i], self.tick[i], now, at, self.q[i], u))
        return out

    def command(self, dq, i=0, answer=True, fence=1, based_on=None):
        self.seq += 1
        based_on = self.tick[i] if based_on is None else based_on
        verdict, *plans = self.gate.step(Command(self.names[i], fence, self.seq, based_on, dq))
        if plans:
            self.held[i] = plans[0]
            if answer is not None:
                self.gate.step(PlanAnswer(self.names[i], plans[0].key, answer, "" if answer else "late"))
        return verdict

    def play(self, i=0, index=0):
        """Send a tick that plays the held plan's increment."""
        plan, before = self.held[i], self.q[i]
        u = plan.increments[index]
        self.tick[i] += 1
        self.q[i] = tuple(a + b for a, b in zip(before, u, strict=True))
        now = self.tick[i] * self.cell.robots[i].period
        return self.gate.step(Tick(self.names[i], self.tick[i], now, before, self.q[i], u, plan.key, index))

    def lowest_bound(self, i=0):
        return float(self.gate._clearance.bound.of(i).min())


def pair(gap=0.2):
    return ScriptedGate(scenes.head_on(0.1 + gap, (T, T)))
