"""Lock-step: steps that end when all have had their say. Needs the names of two participants."""

import asyncio
import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import Holder
from armgate.conformance.packing import Fields
from armgate.conformance.target import Target
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check
from armgate.conformance.wire import Wire

_SILENCE = 20.0
"""How long a server may bear a silent participant, s; the kit does not know its bound."""
_STEPS = 12
"""How long a conversation is that is held twice, in steps."""


class Seat:
    """A participant, and the newest step that it was shown."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.step = -1
        self.ticks: dict[str, int] = {}

    @classmethod
    async def take(cls, trial: Trial, number: int) -> "Seat":
        """Connect as one of the participants and subscribe."""
        if len(trial.facts.participants) < 2:
            raise Skip("give --participants A,B: two names of the server's lock-step")
        name = trial.facts.participants[number]
        wire = await trial.target.welcomed(await trial.open(name), name, "controller")
        seat = cls(wire)
        await wire.answered("subscribe", "subscribed", fields=["holder", "setpoint", "applied_seq"])
        await seat.shown(0)
        return seat

    async def shown(self, least: int) -> Fields:
        """The next state of a step that is not before ``least``."""

        def newer(message: Fields) -> bool:
            self._note(message)
            return message["type"] == "state" and bool(message["step"] >= least)

        return await self.wire.hear(newer, f"a state of step {least}")

    def _note(self, message: Fields) -> None:
        if message["type"] == "state":
            self.step = max(self.step, message["step"])
            self.ticks |= {entry["robot"]: entry["tick"] for entry in message["entries"]}

    async def heard(self, least: int) -> list[Fields]:
        """All that comes until the states of a step that is not before ``least`` are there."""
        found: list[Fields] = []
        while not any(m["type"] == "state" and m["step"] >= least for m in found):
            found.append(await self.wire.hear(lambda m: True, f"a state of step {least}"))
        found += await self.wire.heard()
        for message in found:
            self._note(message)
        return found

    def pass_(self, step: int | None = None) -> None:
        """Nothing more for this step."""
        self.wire.say({"type": "pass", "step": self.step if step is None else step})


async def both(trial: Trial) -> tuple[Seat, Seat]:
    """Both participants, shown the same step."""
    first = await Seat.take(trial, 0)
    second = await Seat.take(trial, 1)
    step = max(first.step, second.step)
    for seat in (first, second):
        if seat.step < step:
            await seat.shown(step)
    return first, second


def ended(seat: Seat, found: list[Fields]) -> bool:
    """Whether states of a later step are among messages."""
    return any(m["step"] > seat.step for m in found if m["type"] == "state")


@case(
    "LCK-2/both",
    "One participant passes, then the other",
    "The step ends when both have; before, the other one's connection shows the old step",
    also=("LCK-3",),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    for _ in range(5):
        step = first.step
        first.pass_()
        check(
            not ended(first, await first.wire.heard()), "the step ended before the other participant was done"
        )
        check(
            not ended(second, await second.wire.heard()),
            "the step ended before the other participant was done",
        )
        second.pass_()
        await first.shown(step + 1)
        await second.shown(step + 1)
        check(first.step == second.step == step + 1, f"after step {step} came {first.step} and {second.step}")


@case(
    "LCK-2/command",
    "One holds a robot and commands it, the other passes",
    "That ends the step; the state of the next shows the seq applied",
    also=("LCK-4",),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    lease = await first.wire.answered("acquire", "lease", robot=trial.robot)
    for _ in range(3):
        step, seq = first.step, next(first.wire.ledger.seqs)
        command = {
            "robot": trial.robot,
            "fence": lease["fence"],
            "seq": seq,
            "tick": first.ticks[trial.robot],
        }
        first.wire.say({"type": "command", **command, "dq": [0.0] * trial.n})
        second.pass_()
        verdict = await first.wire.expect("verdict", seq=seq)
        check(
            verdict["outcome"] == "admitted",
            f"the command was {verdict['outcome']}: {verdict.get('reasons')}",
        )
        await first.shown(step + 1)
        await second.shown(step + 1)


@case(
    "LCK-15/ahead",
    "One participant passes; the other sends its passes for this step and the next in one write",
    "The states of the step that ended come at once, before the next step ends",
    also=("LCK-5",),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    for _ in range(3):
        step = first.step
        second.pass_()
        await second.wire.in_step()
        first.wire.say({"type": "pass", "step": step}, {"type": "pass", "step": step + 1})
        await first.shown(step + 1)
        await second.shown(step + 1)
        check(first.step == step + 1, f"step {first.step} was shown before both were done with {step + 1}")
        second.pass_()
        await first.shown(step + 2)
        await second.shown(step + 2)


@case("LCK-3/left", "One participant says bye; the other passes", "The step ends without the one that left")
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    first.wire.say({"type": "bye"})
    await first.wire.ends()
    for _ in range(3):
        step = second.step
        second.pass_()
        await second.shown(step + 1)


@case(
    "LCK-4/at-the-end",
    "Command, ping; then the other participant passes",
    "The pong comes before the verdict, the verdict at the end of the step",
    also=("PNG-3",),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    lease = await first.wire.answered("acquire", "lease", robot=trial.robot)
    seq = next(first.wire.ledger.seqs)
    command = {"robot": trial.robot, "fence": lease["fence"], "seq": seq, "tick": first.ticks[trial.robot]}
    first.wire.say({"type": "command", **command, "dq": [0.0] * trial.n})
    before = [m["type"] for m in await first.wire.heard()]
    check("verdict" not in before, "a command was judged before the end of the step")
    second.pass_()
    await first.wire.expect("verdict", seq=seq)


@case(
    "LCK-4/stranger",
    "One that is no participant commands a robot that a participant holds, in the middle of a step",
    "The verdict comes before the step ends, and refuses",
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    lease = await first.wire.answered("acquire", "lease", robot=trial.robot)
    wire = await trial.client(name="stranger")
    seq = next(wire.ledger.seqs)
    command = {"robot": trial.robot, "fence": lease["fence"], "seq": seq, "tick": first.ticks[trial.robot]}
    command = wire.ledger.forbid({"type": "command", **command, "dq": [0.0] * trial.n}, "it holds no robot")
    wire.say(command)
    verdict = await wire.expect("verdict", seq=seq)
    check(verdict["outcome"] == "refused", f"the command of a stranger was {verdict['outcome']}")
    step = first.step
    for seat in (first, second):
        seat.pass_()
    await first.shown(step + 1)


@case(
    "LCK-16/instants",
    "Pass through ten steps, and look which robots tick in each and when",
    "Each step is the next instant at which a robot ticks; its states come in the order of the robots",
    also=("LCK-17", "LCK-1"),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    robots = trial.facts.description["robots"]
    periods = {robot["name"]: robot["period"] for robot in robots}
    before: Fields | None = None
    for _ in range(10):
        step = first.step + 1
        for seat in (first, second):
            seat.pass_()
        states = [m for m in await first.heard(step) if m["type"] == "state" and m["step"] >= step]
        await second.shown(step)
        check({m["step"] for m in states} == {step}, f"in step {step} came states of {states}")
        names = [m["robot"] for m in states]
        check(names == [name for name in periods if name in names], f"the states came in the order {names}")
        for m in states:
            due = m["tick"] * periods[m["robot"]]
            check(abs(m["time"] - due) < 1e-6, f"tick {m['tick']} of {m['robot']} came at {m['time']} s")
        if before is not None:
            due = min(_next(before["time"], period) for period in periods.values())
            check(abs(states[0]["time"] - due) < 1e-6, f"after {before['time']} s came {states[0]['time']} s")
        before = states[0]


def _next(time: float, period: float) -> float:
    """The first multiple of a period after a time."""
    return period * (math.floor(time / period + 1e-6) + 1)


@case(
    "LCK-18/done",
    "A participant commands its robot and so is done; the robot is stopped; it sends a command and a pass",
    "Both count in the next step; the verdicts come in the order of the commands",
    also=("LCK-5", "CMD-3"),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    wire = await trial.operator()
    lease = await first.wire.answered("acquire", "lease", robot=trial.robot)
    step, seqs = first.step, []
    for ahead in (False, False, True):
        if ahead:
            stop = (await wire.answered("stop", "stopped", robot=trial.robot))["stop"]
        seqs.append(next(first.wire.ledger.seqs))
        command = {"robot": trial.robot, "fence": lease["fence"], "seq": seqs[-1], "dq": [0.0] * trial.n}
        first.wire.say({"type": "command", **command, "tick": first.ticks[trial.robot]})
    first.pass_(step + 1)
    second.pass_()
    heard = [await first.wire.expect("verdict", seq=seqs[0])]
    await second.shown(step + 1)
    second.pass_()
    heard += [await first.wire.hear(lambda m: m["type"] == "verdict", "a verdict") for _ in range(2)]
    check([m["seq"] for m in heard] == seqs, f"sent were {seqs}, judged {[m['seq'] for m in heard]}")
    await first.shown(step + 2)
    await trial.lifted(wire, stop)


@case(
    "LCK-4/order", "Command two robots, the later one first", "The verdicts come in the order of the robots"
)
async def _(trial: Trial) -> None:
    robots = [robot["name"] for robot in trial.facts.description["robots"]][:2]
    if len(robots) < 2:
        raise Skip("the cell has one robot only")
    first, second = await both(trial)
    fences = {name: (await first.wire.answered("acquire", "lease", robot=name))["fence"] for name in robots}
    lengths = {robot["name"]: len(robot["joints"]) for robot in trial.facts.description["robots"]}
    commands = [
        {"type": "command", "robot": name, "fence": fences[name], "seq": next(first.wire.ledger.seqs), "tick": first.ticks[name], "dq": [0.0] * lengths[name]}
        for name in reversed(robots)
    ]  # fmt: skip
    first.wire.say(*commands)
    second.pass_()
    told = [(await first.wire.expect("verdict"))["robot"] for _ in robots]
    check(told == robots, f"the verdicts came for {told}, the robots are {robots}")


@case(
    "LCK-5/ahead",
    "Pass, then describe; then the other participant passes",
    "The description comes in the next step, not in this one",
    also=("PNG-3",),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    step = first.step
    first.pass_()
    first.wire.say({"type": "describe", "id": 900})
    early = [m["type"] for m in await first.wire.heard()]
    check("description" not in early, "what was said after pass was done in the same step")
    second.pass_()
    kinds: list[str] = []
    await first.wire.hear(lambda m: kinds.append(m["type"]) or m.get("re") == 900, "the description")  # type: ignore[func-returns-value]
    check("state" in kinds, f"it came before the state of step {step + 1}: {kinds}")


for _slug, _by in {"before": -1, "ahead": 1}.items():

    @case(
        f"LCK-6/{_slug}",
        f"Pass for the step {_by:+} from the current",
        "A wrong_step, not fatal; the step does not end",
    )
    async def _(trial: Trial, by: int = _by) -> None:
        first, second = await both(trial)
        if first.step + by < 0:
            first.pass_()
            second.pass_()
            await first.shown(first.step + 1)
            await second.shown(first.step)
        first.pass_(first.step + by)
        await first.wire.expect("error", code="wrong_step", fatal=False, about="pass")
        second.pass_()
        check(not ended(second, await second.wire.heard()), "the step ended by a pass for another step")


_STRANGER: dict[str, Any] = {
    "acquire": {"robot": "R"},
    "signal": {"name": "kit/stranger", "value": [1.0]},
    "pass": {"step": 0},
}

for _kind, _fields in _STRANGER.items():

    @case(f"LCK-7/{_kind}", f"Connect by another name and {_kind}", "A not_participant, not fatal")
    async def _(trial: Trial, kind: str = _kind, fields: Any = _fields) -> None:
        wire = await trial.client()
        wire.say({"type": kind, **fields, **({"robot": trial.robot} if "robot" in fields else {})})
        await wire.expect("error", code="not_participant", fatal=False, about=kind)
        await wire.in_step()


@case(
    "LCK-8/stranger",
    "One that is no participant describes, subscribes, pings; the participants go on",
    "It is answered, and never waited for",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    await wire.answered("describe", "description")
    await wire.answered("subscribe", "subscribed")
    first, second = await both(trial)
    step = first.step
    for seat in (first, second):
        seat.pass_()
    await first.shown(step + 1)
    await wire.hear(lambda m: m["type"] == "state" and m["step"] == step + 1, "the state of the next step")
    await wire.in_step()


@case(
    "LCK-9/taken",
    "Say hello by the name of a participant that is connected",
    "A fatal name_taken; the participant goes on",
)
async def _(trial: Trial) -> None:
    first, _ = await both(trial)
    wire = await trial.open("double")
    wire.say(trial.target.hello(trial.facts.participants[0], "controller"))
    await wire.fails("name_taken")
    await first.wire.heard()


@case(
    "LCK-11/bound",
    "Pass, then 256 messages ahead of the step, then more",
    "256 are borne; a session that sends more is ended by a fatal too_many",
)
async def _(trial: Trial) -> None:
    first, _ = await both(trial)
    first.pass_()
    first.wire.say(*({"type": "describe", "id": 2000 + i} for i in range(256)))
    await first.wire.heard()
    first.wire.say({"type": "describe"})
    await first.wire.fails("too_many")


@case("LEA-15/kept", "Hold a robot and let more than the ttl pass within a step", "It is still held")
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    lease = await first.wire.answered("acquire", "lease", robot=trial.robot)
    # Nothing may happen meanwhile: this is the time that must not count.
    await asyncio.sleep(1.2 * trial.facts.ttl)
    step = first.step
    first.pass_()
    second.pass_()
    await first.shown(step + 1)
    answer = await first.wire.answered("release", "lease", robot=trial.robot, fence=lease["fence"])
    check(answer["state"] == "released", f"the lease is {answer['state']}")


@case("PNG-3/midway", "Ping before and after pass, in the middle of a step", "Each pong comes at once")
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    await first.wire.heard()
    first.pass_()
    await first.wire.heard()
    await second.wire.heard()


@case(
    "LCK-10/silent",
    "Both connect; one passes, the other says nothing",
    f"Within {_SILENCE:g} s the silent one is ended by a fatal silent, and the step ends without it",
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    step = first.step
    first.pass_()
    await second.wire.fails("silent", within=_SILENCE)
    await first.shown(step + 1)


@case(
    "LCK-12/faster",
    f"On two servers of their own, the same {_STEPS} steps: in one the first participant speaks first, in the other the last",
    "Both participants are sent the same verdicts and states in both",
)
async def _(trial: Trial) -> None:
    if len(trial.facts.participants) < 2:
        raise Skip("give --participants A,B: two names of the server's lock-step")
    async with trial.anew() as one, trial.anew() as other:
        first, second = await _told(trial, one, (0, 1)), await _told(trial, other, (1, 0))
    for name, here, there in zip(trial.facts.participants, first, second, strict=False):
        for a, b in zip(here, there, strict=False):
            check(a == b, f"{name} was told {a} where the first was faster, {b} where it was not")
        check(len(here) == len(there) > _STEPS, f"{name} was told {len(here)} and {len(there)} of them")


async def _told(trial: Trial, target: Target, order: tuple[int, int]) -> list[list[Fields]]:
    """The verdicts and states that two participants were sent, of steps in which they spoke in this order."""
    seats = [Seat(await trial.visit(target, name)) for name in trial.facts.participants[:2]]
    told: list[list[Fields]] = [[], []]
    for seat in seats:
        await seat.wire.answered("subscribe", "subscribed")
        await seat.shown(0)
    held = {}
    for number, robot in enumerate(trial.facts.description["robots"][:2]):
        lease = await seats[number].wire.answered("acquire", "lease", robot=robot["name"])
        held[number] = Holder(seats[number].wire, robot, lease, trial.observer)
    for step in range(_STEPS):
        first, last = order
        _speak(seats[first], held.get(first), step)
        told[first] += await seats[first].wire.heard()  # (so that it was heard before the other speaks)
        _speak(seats[last], held.get(last), step)
        for number, seat in enumerate(seats):
            told[number] += await seat.heard(seat.step + 1)
    return [[m for m in heard if m["type"] in ("state", "verdict")] for heard in told]


def _speak(seat: Seat, holder: Holder | None, step: int) -> None:
    """A signal, and a command of what is held or nothing more."""
    seat.wire.say({"type": "signal", "name": f"kit/{seat.wire.name}", "value": [float(step)]})
    if holder is None:
        seat.pass_()
    else:
        dq = [0.001 * math.sin(step), *[0.0] * (holder.n - 1)]
        seat.wire.say(holder.command(seat.ticks[holder.robot], dq))


@case(
    "LCK-2/marks",
    "Look at welcome, description and states",
    "lockstep is true in both, states have a step",
    also=("LCK-1",),
)
async def _(trial: Trial) -> None:
    first, second = await both(trial)
    check(first.wire.welcome.get("lockstep") is True, "welcome does not say lockstep")
    check(trial.facts.description["lockstep"] is True, "the description does not say lockstep")
    check(first.step >= 0 and second.step >= 0, "states have no step")
