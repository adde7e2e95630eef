"""Client that holds the lease of a robot, and checks of the verdicts and states that it receives."""

from collections.abc import Callable
from typing import Any

from armgate.conformance.case import Violation, check
from armgate.conformance.codec import Fields
from armgate.conformance.connection import Connection
from armgate.conformance.observer import Observer

_ATTEMPTS = 40
"""Number of attempts of a command that comes too late on a busy machine."""

_ATTEMPTS_TOGETHER = 20
"""Number of attempts to send commands in one write without a tick between them."""

_LATE = {"stale", "occupied"}
_GENTLE = 0.4
"""Size of a small increment, as a share of a joint's largest increment."""


class LeaseHolder:
    """Client that holds the lease of one robot.

    Args:
        connection: Its connection, after the welcome.
        robot: The robot's description.
        lease: The lease that it was granted.
        observer: Observer that receives the position of the robot.
    """

    def __init__(self, connection: Connection, robot: Fields, lease: Fields, observer: Observer) -> None:
        self.connection = connection
        self.robot: str = robot["name"]
        self.fence: int = lease["fence"]
        self.lease = lease
        self.n = len(robot["joints"])
        self._joints = robot["joints"]
        self._period = robot["period"]
        self._observer = observer
        self._seen = -1

    async def next_state(self) -> Fields:
        """Return the newest state of a tick of the robot; wait for a newer one if it was returned before."""
        kept: list[Fields] = []
        newest: Fields | None = None
        while newest is None or any(m["type"] == "state" for m in self.connection.inbox):
            message = await self.connection.receive(lambda m: True, f"a state of {self.robot}")
            if message["type"] != "state":
                kept.append(message)
            elif message["robot"] == self.robot and message["tick"] > self._seen:
                newest, self._seen = message, message["tick"]
        self.connection.inbox.extendleft(reversed(kept))
        return newest

    def small_increment(self, share: float = 1.0) -> list[float]:
        """Return a small increment of the joint with most room, away from its nearer limit."""
        setpoint = self._observer.entries[self.robot]["setpoint"]
        rooms = [max(j["upper"] - q, q - j["lower"]) for j, q in zip(self._joints, setpoint, strict=True)]
        chosen = rooms.index(max(rooms))
        bounds, q = self._joints[chosen], setpoint[chosen]
        able = min(bounds["velocity"] * self._period, bounds["acceleration"] * self._period**2)
        sign = 1.0 if bounds["upper"] - q > q - bounds["lower"] else -1.0
        return [sign * share * _GENTLE * able if j == chosen else 0.0 for j in range(self.n)]

    def make_command(self, tick: int, dq: Any = None, **more: Any) -> Fields:
        """Return a command that is not yet sent."""
        seq = next(self.connection.commands.seqs)
        fields = {"robot": self.robot, "fence": self.fence, "seq": seq, "tick": tick}
        return {"type": "command", **fields, "dq": self.small_increment() if dq is None else dq, **more}

    async def send_command(self, command: Fields) -> Fields:
        """Send a command and return its verdict."""
        self.connection.send(command)
        return await self.connection.expect("verdict", seq=command["seq"], robot=command["robot"])

    def forbid(self, command: Fields, why: str) -> Fields:
        """Note that this command must not be executed; the safety outcome fails if the server applies it."""
        return self.connection.commands.forbid(command, why)

    async def command(self, dq: Any = None, forbidden: str = "", **more: Any) -> Fields:
        """Send a command based on the newest tick and return its verdict; repeat it if it came too late.

        Args:
            dq: Its increment; None: a small one.
            forbidden: Reason why the robot must not execute it; "" if it may.
            more: Other fields.

        Raises:
            Violation: It came too late every time.
        """
        for _ in range(_ATTEMPTS):
            state = await self.next_state()
            command = self.make_command(state["tick"], dq, **more)
            if forbidden:
                self.forbid(command, forbidden)
            verdict = await self.send_command(command)
            if cause_of(verdict) not in _LATE:
                return verdict
        raise Violation(f"{_ATTEMPTS} commands in a row came too late: {verdict.get('reasons')}")

    async def move(self, dq: Any = None) -> Fields:
        """Send a small increment and return its verdict, which must not be a refusal.

        Raises:
            Violation: It is refused.
        """
        verdict = await self.command(dq)
        check(verdict["outcome"] != "refused", f"a small increment was refused: {verdict.get('reasons')}")
        return verdict

    async def state_applying(self, verdict: Fields) -> Fields:
        """Return the state that shows the command of a verdict as applied."""
        robot, seq = self.robot, verdict["seq"]
        return await self.connection.receive(
            lambda m: m["type"] == "state" and entry_of(m, robot).get("applied_seq") == seq,
            f"a state of {robot} with applied_seq {seq}",
        )


async def state_after_now(client: Connection, robot: str) -> Fields:
    """Return the first state of a robot whose tick is later than all previous answers to this client."""
    now = (await client.call("ping", "pong", time=0.0))["received"]
    return await client.receive(
        lambda m: m["type"] == "state" and m["robot"] == robot and m["time"] > now,
        f"a state of {robot} after {now}",
    )


def cause_of(verdict: Fields) -> str | None:
    """Return the first cause that a verdict names."""
    reasons = verdict.get("reasons") or ()
    return reasons[0]["cause"] if reasons else None


def entry_of(state: Fields, robot: str) -> Fields:
    """Return the entry of one robot in a state."""
    return next((entry for entry in state["entries"] if entry["robot"] == robot), {})


def check_refused(verdict: Fields, expected: str) -> None:
    """Check that a verdict is a refusal with one cause, from the checks before the gate's decision.

    Raises:
        Violation: The verdict is another one.
    """
    found = (verdict["outcome"], verdict["target"], cause_of(verdict))
    text = f"expected a refusal by {expected} with target nil, got {found[0]} by {found[2]}"
    check(found == ("refused", None, expected), f"{text} with target {found[1]}")


def check_admitted(verdict: Fields) -> None:
    """Check that a verdict admits a command unchanged.

    Raises:
        Violation: The verdict is another one.
    """
    check(
        verdict["outcome"] == "admitted",
        f"expected admitted, got {verdict['outcome']}: {verdict.get('reasons')}",
    )


async def send_together(holder: LeaseHolder, *makes: Callable[[int], Fields], good: int = -1) -> list[Fields]:
    """Send commands in one write, based on one tick, and return their verdicts; repeat if a tick passed.

    Args:
        holder: Client that sends them.
        makes: Functions that make a command from a tick.
        good: Index of the command that must not come too late.

    Raises:
        Violation: A tick passed between them every time.
    """
    for _ in range(_ATTEMPTS_TOGETHER):
        tick = (await holder.next_state())["tick"]
        commands = [make(tick) for make in makes]
        holder.connection.send(*commands)
        verdicts = [await holder.connection.expect("verdict", seq=command["seq"]) for command in commands]
        main = verdicts[good]
        if cause_of(main) == "occupied" and any(v["target"] is not None for v in verdicts if v is not main):
            return verdicts  # the slot went to one of these, not to an earlier command
        targets = {verdict["target"] for verdict in verdicts} - {None}
        if len(targets) < 2 and cause_of(main) not in ("stale", "occupied"):
            return verdicts
    raise Violation(f"{_ATTEMPTS_TOGETHER} times in a row a tick passed between commands sent in one write")
