"""A connection that holds a robot: fresh ticks, commands, their verdicts."""

from typing import Any

from armgate.conformance.observer import Observer
from armgate.conformance.packing import Fields
from armgate.conformance.verdicts import Unmet, check
from armgate.conformance.wire import Wire

_TRIES = 40
"""How often a command is sent again that came too late on a busy machine."""

_TOGETHER = 20
"""How often commands are sent again between which a tick passed."""

_LATE = {"stale", "occupied"}
_GENTLE = 0.4
"""The share of what a joint could do that a small increment asks for."""


class Holder:
    """Holds one robot.

    Args:
        wire: Its connection, welcomed.
        robot: The robot's description.
        lease: The lease that it was given.
        observer: Knows where the robot is.
    """

    def __init__(self, wire: Wire, robot: Fields, lease: Fields, observer: Observer) -> None:
        self.wire = wire
        self.robot: str = robot["name"]
        self.fence: int = lease["fence"]
        self.lease = lease
        self.n = len(robot["joints"])
        self._joints = robot["joints"]
        self._period = robot["period"]
        self._observer = observer
        self._seen = -1

    async def fresh(self) -> Fields:
        """The newest state at a tick of the robot that was not given before; older ones are dropped."""
        kept: list[Fields] = []
        newest: Fields | None = None
        while newest is None or any(m["type"] == "state" for m in self.wire.inbox):
            message = await self.wire.hear(lambda m: True, f"a state of {self.robot}")
            if message["type"] != "state":
                kept.append(message)
            elif message["robot"] == self.robot and message["tick"] > self._seen:
                newest, self._seen = message, message["tick"]
        self.wire.inbox.extendleft(reversed(kept))
        return newest

    def small(self, share: float = 1.0, joint: int | None = None) -> list[float]:
        """A small increment of the joint with most room, away from its nearer limit."""
        setpoint = self._observer.entries[self.robot]["setpoint"]
        rooms = [max(j["upper"] - q, q - j["lower"]) for j, q in zip(self._joints, setpoint, strict=True)]
        chosen = rooms.index(max(rooms)) if joint is None else joint
        bounds, q = self._joints[chosen], setpoint[chosen]
        able = min(bounds["velocity"] * self._period, bounds["acceleration"] * self._period**2)
        sign = 1.0 if bounds["upper"] - q > q - bounds["lower"] else -1.0
        return [sign * share * _GENTLE * able if j == chosen else 0.0 for j in range(self.n)]

    def command(self, tick: int, dq: Any = None, **more: Any) -> Fields:
        """A command, not yet sent."""
        fields = {"robot": self.robot, "fence": self.fence, "seq": next(self.wire.ledger.seqs), "tick": tick}
        return {"type": "command", **fields, "dq": self.small() if dq is None else dq, **more}

    async def verdict(self, command: Fields) -> Fields:
        """Send a command; its verdict."""
        self.wire.say(command)
        return await self.wire.expect("verdict", seq=command["seq"], robot=command["robot"])

    def forbid(self, command: Fields, why: str) -> Fields:
        """This command must not be done: a server that lets it through is unsafe, not only impolite."""
        return self.wire.ledger.forbid(command, why)

    async def decided(self, dq: Any = None, forbidden: str = "", **more: Any) -> Fields:
        """The verdict of a command based on a fresh tick; sent anew where it came too late.

        Args:
            dq: Its increment, None: a small one.
            forbidden: Why the robot must not do it, "": it may.
            more: Other fields.

        Raises:
            Unmet: It always comes too late.
        """
        for _ in range(_TRIES):
            state = await self.fresh()
            command = self.command(state["tick"], dq, **more)
            if forbidden:
                self.forbid(command, forbidden)
            verdict = await self.verdict(command)
            if cause(verdict) not in _LATE:
                return verdict
        raise Unmet(f"{_TRIES} commands in a row came too late: {verdict.get('reasons')}")

    async def moved(self, dq: Any = None) -> Fields:
        """The verdict of a small increment that is let through.

        Raises:
            Unmet: It is refused.
        """
        verdict = await self.decided(dq)
        check(verdict["outcome"] != "refused", f"a small increment was refused: {verdict.get('reasons')}")
        return verdict

    async def applied(self, verdict: Fields) -> Fields:
        """The state that shows a command applied."""
        robot, seq = self.robot, verdict["seq"]
        return await self.wire.hear(
            lambda m: m["type"] == "state" and entry(m, robot).get("applied_seq") == seq,
            f"a state of {robot} with applied_seq {seq}",
        )


async def later(wire: Wire, robot: str) -> Fields:
    """The first state of a robot whose tick was after all that this connection has been answered so far."""
    now = (await wire.answered("ping", "pong", time=0.0))["received"]
    return await wire.hear(
        lambda m: m["type"] == "state" and m["robot"] == robot and m["time"] > now,
        f"a state of {robot} after {now}",
    )


def cause(verdict: Fields) -> str | None:
    """The first cause that a verdict names."""
    reasons = verdict.get("reasons") or ()
    return reasons[0]["cause"] if reasons else None


def entry(state: Fields, robot: str) -> Fields:
    """One robot's entry in a state."""
    return next((one for one in state["entries"] if one["robot"] == robot), {})


def refused(verdict: Fields, expected: str) -> None:
    """Check that a verdict refuses before the gate, for one cause.

    Raises:
        Unmet: It does not.
    """
    told = (verdict["outcome"], verdict["target"], cause(verdict))
    check(
        told == ("refused", None, expected),
        f"expected a refusal by {expected} with target nil, got {told[0]} by {told[2]} with target {told[1]}",
    )


def admitted(verdict: Fields) -> None:
    """Check that a verdict lets a command through as it was asked."""
    check(
        verdict["outcome"] == "admitted",
        f"expected admitted, got {verdict['outcome']}: {verdict.get('reasons')}",
    )


async def together(holder: Holder, *makes: Any, good: int = -1) -> list[Fields]:
    """The verdicts of commands sent in one write, all based on one fresh tick that did not pass meanwhile.

    Args:
        holder: Sends them.
        makes: Make the commands of a tick.
        good: Which of them must not have come too late.

    Raises:
        Unmet: The tick always passed.
    """
    for _ in range(_TOGETHER):
        tick = (await holder.fresh())["tick"]
        commands = [make(tick) for make in makes]
        holder.wire.say(*commands)
        verdicts = [await holder.wire.expect("verdict", seq=command["seq"]) for command in commands]
        told = verdicts[good]
        if cause(told) == "occupied" and any(v["target"] is not None for v in verdicts if v is not told):
            return verdicts  # the slot went to one of these, not to an earlier command
        targets = {verdict["target"] for verdict in verdicts} - {None}
        if len(targets) < 2 and cause(told) not in ("stale", "occupied"):
            return verdicts
    raise Unmet(f"{_TOGETHER} times in a row a tick passed between commands sent in one write")
