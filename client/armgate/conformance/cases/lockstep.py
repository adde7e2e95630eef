"""Lock-step: steps that end when all participants are done. Needs the names of two participants."""

import asyncio
import math
from functools import partial
from typing import Any

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import LeaseHolder
from armgate.conformance.target import Target

_SILENCE = 20.0
"""Time after which a server must end a silent participant, s; the kit does not know its limit."""
_STEPS = 12
"""Length of the conversation that runs twice, in steps."""
_AHEAD = 250
"""Number of passes that are sent at once; a server accepts at least 256 messages ahead."""


class Participant:
    """Client that is a participant, and the newest step of which it has received a state."""

    def __init__(self, client: Connection) -> None:
        self.connection = client
        self.step = -1
        self.ticks: dict[str, int] = {}

    @classmethod
    async def join(cls, ctx: CaseContext, number: int) -> "Participant":
        """Connect as one of the participants and subscribe."""
        if len(ctx.server.participants) < 2:
            raise Skip("give --participants A,B: two names of the server's lock-step")
        name = ctx.server.participants[number]
        client = await ctx.target.handshake(await ctx.connect(name), name, "controller")
        participant = cls(client)
        await client.call("subscribe", "subscribed", fields=["holder", "setpoint", "applied_seq"])
        await participant.wait_step(0)
        return participant

    async def wait_step(self, least: int) -> Fields:
        """Return the next state whose step is ``least`` or later."""

        def newer(message: Fields) -> bool:
            self._update(message)
            return message["type"] == "state" and bool(message["step"] >= least)

        return await self.connection.receive(newer, f"a state of step {least}")

    def _update(self, message: Fields) -> None:
        if message["type"] == "state":
            self.step = max(self.step, message["step"])
            self.ticks |= {entry["robot"]: entry["tick"] for entry in message["entries"]}

    async def receive_until_step(self, least: int) -> list[Fields]:
        """Return all messages up to and including the states of the first step that is ``least`` or later."""
        found: list[Fields] = []
        while not any(m["type"] == "state" and m["step"] >= least for m in found):
            found.append(await self.connection.receive(lambda m: True, f"a state of step {least}"))
        found += await self.connection.drain()
        for message in found:
            self._update(message)
        return found

    def pass_(self, step: int | None = None) -> None:
        """Send ``pass`` for a step; by default the current one."""
        self.connection.send({"type": "pass", "step": self.step if step is None else step})


async def join_both(ctx: CaseContext) -> tuple[Participant, Participant]:
    """Return both participants, after states of the same step."""
    first = await Participant.join(ctx, 0)
    second = await Participant.join(ctx, 1)
    step = max(first.step, second.step)
    for participant in (first, second):
        if participant.step < step:
            await participant.wait_step(step)
    return first, second


def has_later_step(participant: Participant, found: list[Fields]) -> bool:
    """Return True if states of a later step are among messages."""
    return any(m["step"] > participant.step for m in found if m["type"] == "state")


@case(
    "LCK-2/both",
    "One participant passes, then the other",
    "The step ends when both have passed, not before",
    also=("LCK-3",),
)
async def step_ends_when_all_participants_have_passed(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    for _ in range(5):
        step = first.step
        first.pass_()
        check(
            not has_later_step(first, await first.connection.drain()),
            "the step ended before the other participant was done",
        )
        check(
            not has_later_step(second, await second.connection.drain()),
            "the step ended before the other participant was done",
        )
        second.pass_()
        await first.wait_step(step + 1)
        await second.wait_step(step + 1)
        check(first.step == second.step == step + 1, f"after step {step} came {first.step} and {second.step}")


@case(
    "LCK-2/command",
    "One participant holds a robot and commands it; the other passes",
    "The command ends the step; the state of the next step shows its seq as applied",
    also=("LCK-4",),
)
async def command_ends_the_participants_part_of_a_step(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    lease = await first.connection.call("acquire", "lease", robot=ctx.robot)
    for _ in range(3):
        step, seq = first.step, next(first.connection.commands.seqs)
        command = {
            "robot": ctx.robot,
            "fence": lease["fence"],
            "seq": seq,
            "tick": first.ticks[ctx.robot],
        }
        first.connection.send({"type": "command", **command, "dq": [0.0] * ctx.n})
        second.pass_()
        verdict = await first.connection.expect("verdict", seq=seq)
        check(
            verdict["outcome"] == "admitted",
            f"the command was {verdict['outcome']}: {verdict.get('reasons')}",
        )
        await first.wait_step(step + 1)
        await second.wait_step(step + 1)


@case(
    "LCK-15/ahead",
    "One participant passes; the other sends its passes for this step and the next in one write",
    "The states of the step that ended come at once, before the next step ends",
    also=("LCK-5",),
)
async def states_of_an_ended_step_come_at_once(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    for _ in range(3):
        step = first.step
        second.pass_()
        await second.connection.sync()
        first.connection.send({"type": "pass", "step": step}, {"type": "pass", "step": step + 1})
        await first.wait_step(step + 1)
        await second.wait_step(step + 1)
        check(first.step == step + 1, f"step {first.step} was shown before both were done with {step + 1}")
        second.pass_()
        await first.wait_step(step + 2)
        await second.wait_step(step + 2)


@case(
    "LCK-3/left",
    "One participant sends bye; the other passes",
    "The step ends without the participant that left",
)
async def step_ends_without_a_participant_that_left(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    first.connection.send({"type": "bye"})
    await first.connection.receive_until_closed()
    for _ in range(3):
        step = second.step
        second.pass_()
        await second.wait_step(step + 1)


@case(
    "LCK-4/at-the-end",
    "Send a command and a ping; then the other participant passes",
    "The pong comes before the verdict, the verdict at the end of the step",
    also=("PNG-3",),
)
async def commands_are_decided_at_the_end_of_the_step(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    lease = await first.connection.call("acquire", "lease", robot=ctx.robot)
    seq = next(first.connection.commands.seqs)
    command = {"robot": ctx.robot, "fence": lease["fence"], "seq": seq, "tick": first.ticks[ctx.robot]}
    first.connection.send({"type": "command", **command, "dq": [0.0] * ctx.n})
    before = [m["type"] for m in await first.connection.drain()]
    check("verdict" not in before, "a command was decided before the end of the step")
    second.pass_()
    await first.connection.expect("verdict", seq=seq)


@case(
    "LCK-4/stranger",
    "A client that is not a participant commands a robot that a participant holds, in the middle of a step",
    "The verdict, a refusal, comes before the step ends",
)
async def command_of_a_non_participant_is_decided_at_once(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    lease = await first.connection.call("acquire", "lease", robot=ctx.robot)
    client = await ctx.client(name="non-participant")
    seq = next(client.commands.seqs)
    command = {"robot": ctx.robot, "fence": lease["fence"], "seq": seq, "tick": first.ticks[ctx.robot]}
    command = client.commands.forbid({"type": "command", **command, "dq": [0.0] * ctx.n}, "it holds no robot")
    client.send(command)
    verdict = await client.expect("verdict", seq=seq)
    check(verdict["outcome"] == "refused", f"the command of a non-participant was {verdict['outcome']}")
    step = first.step
    for participant in (first, second):
        participant.pass_()
    await first.wait_step(step + 1)


@case(
    "LCK-16/instants",
    "Pass ten steps; check which robots tick in each, and when",
    "Each step is the next instant at which a robot ticks; its states come in the order of the robots",
    also=("LCK-17", "LCK-1"),
)
async def steps_are_the_instants_at_which_robots_tick(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    robots = ctx.server.description["robots"]
    periods = {robot["name"]: robot["period"] for robot in robots}
    before: Fields | None = None
    for _ in range(10):
        step = first.step + 1
        for participant in (first, second):
            participant.pass_()
        states = [
            m for m in await first.receive_until_step(step) if m["type"] == "state" and m["step"] >= step
        ]
        await second.wait_step(step)
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
    """Return the first multiple of a period after a time."""
    return period * (math.floor(time / period + 1e-6) + 1)


@case(
    "LCK-18/done",
    "A participant completes its part of a step by a command; the robot is stopped; the participant sends a command and a pass",
    "Both apply to the next step; the verdicts come in the order of the commands",
    also=("LCK-5", "CMD-3"),
)
async def participant_that_was_done_stays_done_after_a_stop(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    client = await ctx.operator()
    lease = await first.connection.call("acquire", "lease", robot=ctx.robot)
    step, seqs = first.step, []
    for ahead in (False, False, True):
        if ahead:
            stop = (await client.call("stop", "stopped", robot=ctx.robot))["stop"]
        seqs.append(next(first.connection.commands.seqs))
        command = {"robot": ctx.robot, "fence": lease["fence"], "seq": seqs[-1], "dq": [0.0] * ctx.n}
        first.connection.send({"type": "command", **command, "tick": first.ticks[ctx.robot]})
    first.pass_(step + 1)
    second.pass_()
    verdicts = [await first.connection.expect("verdict", seq=seqs[0])]
    await second.wait_step(step + 1)
    second.pass_()
    verdicts += [
        await first.connection.receive(lambda m: m["type"] == "verdict", "a verdict") for _ in range(2)
    ]
    check([m["seq"] for m in verdicts] == seqs, f"sent {seqs}, verdicts for {[m['seq'] for m in verdicts]}")
    await first.wait_step(step + 2)
    await ctx.reset_stop(client, stop)


@case(
    "LCK-4/order", "Command two robots, the later one first", "The verdicts come in the order of the robots"
)
async def verdicts_come_in_the_order_of_the_robots(ctx: CaseContext) -> None:
    robots = [robot["name"] for robot in ctx.server.description["robots"]][:2]
    if len(robots) < 2:
        raise Skip("the cell has only one robot")
    first, second = await join_both(ctx)
    fences = {name: (await first.connection.call("acquire", "lease", robot=name))["fence"] for name in robots}
    lengths = {robot["name"]: len(robot["joints"]) for robot in ctx.server.description["robots"]}
    commands = [
        {"type": "command", "robot": name, "fence": fences[name], "seq": next(first.connection.commands.seqs), "tick": first.ticks[name], "dq": [0.0] * lengths[name]}
        for name in reversed(robots)
    ]  # fmt: skip
    first.connection.send(*commands)
    second.pass_()
    order = [(await first.connection.expect("verdict"))["robot"] for _ in robots]
    check(order == robots, f"the verdicts came for {order}, the robots are {robots}")


@case(
    "LCK-5/ahead",
    "Pass, then describe; then the other participant passes",
    "The description comes in the next step, not in this one",
    also=("PNG-3",),
)
async def messages_ahead_of_the_step_wait_for_it(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    step = first.step
    first.pass_()
    first.connection.send({"type": "describe", "id": 900})
    early = [m["type"] for m in await first.connection.drain()]
    check("description" not in early, "a message after pass was processed in the same step")
    second.pass_()
    kinds: list[str] = []
    await first.connection.receive(lambda m: kinds.append(m["type"]) or m.get("re") == 900, "the description")  # type: ignore[func-returns-value]
    check("state" in kinds, f"it came before the state of step {step + 1}: {kinds}")


async def pass_for_another_step_is_refused(ctx: CaseContext, by: int) -> None:
    first, second = await join_both(ctx)
    if first.step + by < 0:
        first.pass_()
        second.pass_()
        await first.wait_step(first.step + 1)
        await second.wait_step(first.step)
    first.pass_(first.step + by)
    await first.connection.expect("error", code="wrong_step", fatal=False, about="pass")
    second.pass_()
    check(
        not has_later_step(second, await second.connection.drain()),
        "the step ended by a pass for another step",
    )


for _slug, _by in {"before": -1, "ahead": 1}.items():
    case(
        f"LCK-6/{_slug}",
        f"Pass for the current step {_by:+}",
        "An error wrong_step, not fatal; the step does not end",
    )(partial(pass_for_another_step_is_refused, by=_by))


_ACTIONS: dict[str, Any] = {
    "acquire": {"robot": "R"},
    "signal": {"name": "kit/stranger", "value": [1.0]},
    "pass": {"step": 0},
}


async def non_participant_cannot_act(ctx: CaseContext, kind: str, fields: Any) -> None:
    client = await ctx.client()
    client.send({"type": kind, **fields, **({"robot": ctx.robot} if "robot" in fields else {})})
    await client.expect("error", code="not_participant", fatal=False, about=kind)
    await client.sync()


for _kind, _fields in _ACTIONS.items():
    case(f"LCK-7/{_kind}", f"Connect under another name and {_kind}", "An error not_participant, not fatal")(
        partial(non_participant_cannot_act, kind=_kind, fields=_fields)
    )


@case(
    "LCK-8/stranger",
    "A client that is not a participant sends describe, subscribe and ping; the participants continue",
    "It is answered, and no step waits for it",
)
async def non_participant_is_answered_but_not_waited_for(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    await client.call("describe", "description")
    await client.call("subscribe", "subscribed")
    first, second = await join_both(ctx)
    step = first.step
    for participant in (first, second):
        participant.pass_()
    await first.wait_step(step + 1)
    await client.receive(
        lambda m: m["type"] == "state" and m["step"] == step + 1, "the state of the next step"
    )
    await client.sync()


@case(
    "LCK-9/taken",
    "Send hello with the name of a participant that is connected",
    "A fatal error name_taken; the participant continues",
)
async def name_of_a_connected_participant_is_taken(ctx: CaseContext) -> None:
    first, _ = await join_both(ctx)
    client = await ctx.connect("double")
    client.send(ctx.target.hello(ctx.server.participants[0], "controller"))
    await client.expect_fatal("name_taken")
    await first.connection.drain()


@case(
    "LCK-11/bound",
    "Pass, then 256 messages ahead of the step, then more",
    "256 are accepted; a session that sends more is ended by a fatal error too_many",
)
async def messages_ahead_of_the_step_are_limited(ctx: CaseContext) -> None:
    first, _ = await join_both(ctx)
    first.pass_()
    first.connection.send(*({"type": "describe", "id": 2000 + i} for i in range(256)))
    await first.connection.drain()
    first.connection.send({"type": "describe"})
    await first.connection.expect_fatal("too_many")


@case("LEA-15/kept", "Hold a robot and let more than the ttl pass within a step", "It is still held")
async def lease_does_not_expire_within_a_step(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    lease = await first.connection.call("acquire", "lease", robot=ctx.robot)
    # The kit sends nothing meanwhile: this time must not count for the lease.
    await asyncio.sleep(1.2 * ctx.server.ttl)
    step = first.step
    first.pass_()
    second.pass_()
    await first.wait_step(step + 1)
    answer = await first.connection.call("release", "lease", robot=ctx.robot, fence=lease["fence"])
    check(answer["state"] == "released", f"the lease is {answer['state']}")


@case("PNG-3/midway", "Ping before and after pass, in the middle of a step", "Each pong comes at once")
async def ping_is_answered_at_once(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    await first.connection.drain()
    first.pass_()
    await first.connection.drain()
    await second.connection.drain()


@case(
    "LCK-10/silent",
    "Both connect; one passes, the other sends nothing",
    f"Within {_SILENCE:g} s the session of the silent participant is ended by a fatal error silent, and the step ends without it",
)
async def silent_participant_is_ended(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    step = first.step
    first.pass_()
    await second.connection.expect_fatal("silent", within=_SILENCE)
    await first.wait_step(step + 1)


@case(
    "LCK-12/faster",
    f"On two new servers, run the same {_STEPS} steps: on one the first participant sends first, on the other the second one",
    "Each participant receives the same verdicts and states on both servers",
)
async def order_of_the_participants_messages_has_no_effect(ctx: CaseContext) -> None:
    if len(ctx.server.participants) < 2:
        raise Skip("give --participants A,B: two names of the server's lock-step")
    async with ctx.second_server() as one, ctx.second_server() as other:
        first, second = await _conversation(ctx, one, (0, 1)), await _conversation(ctx, other, (1, 0))
    for name, here, there in zip(ctx.server.participants, first, second, strict=False):
        for a, b in zip(here, there, strict=False):
            check(
                a == b, f"{name} received {a} if the first participant sent first, {b} if the second one did"
            )
        check(len(here) == len(there) > _STEPS, f"{name} received {len(here)} and {len(there)} messages")


async def _conversation(ctx: CaseContext, target: Target, order: tuple[int, int]) -> list[list[Fields]]:
    """Return the verdicts and states that two participants receive if they send in this order in each step."""
    participants = [Participant(await ctx.client_of(target, name)) for name in ctx.server.participants[:2]]
    received: list[list[Fields]] = [[], []]
    for participant in participants:
        await participant.connection.call("subscribe", "subscribed")
        await participant.wait_step(0)
    held = {}
    for number, robot in enumerate(ctx.server.description["robots"][:2]):
        lease = await participants[number].connection.call("acquire", "lease", robot=robot["name"])
        held[number] = LeaseHolder(participants[number].connection, robot, lease, ctx.observer)
    for step in range(_STEPS):
        first, last = order
        _act(participants[first], held.get(first), step)
        # The server has processed these before the other participant sends.
        received[first] += await participants[first].connection.drain()
        _act(participants[last], held.get(last), step)
        for number, participant in enumerate(participants):
            received[number] += await participant.receive_until_step(participant.step + 1)
    return [[m for m in messages if m["type"] in ("state", "verdict")] for messages in received]


def _act(participant: Participant, holder: LeaseHolder | None, step: int) -> None:
    """Send a signal, and a command for the held robot, or ``pass`` if no robot is held."""
    participant.connection.send(
        {"type": "signal", "name": f"kit/{participant.connection.name}", "value": [float(step)]}
    )
    if holder is None:
        participant.pass_()
    else:
        dq = [0.001 * math.sin(step), *[0.0] * (holder.n - 1)]
        participant.connection.send(holder.make_command(participant.ticks[holder.robot], dq))


@case(
    "LCK-12/late",
    f"One participant sends {_AHEAD} passes and reads only when the other one has passed as often",
    "The late reader receives the states of every step",
    also=("LCK-11", "SUB-11"),
)
async def late_participant_receives_every_state(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    await first.connection.call("subscribe", "subscribed")  # with all fields, so that the buffers fill
    first.connection.pause_reading()
    begin = second.step
    first.connection.send(*({"type": "pass", "step": begin + ahead} for ahead in range(_AHEAD)))
    for step in range(begin, begin + _AHEAD):
        second.pass_()
        await second.wait_step(step + 1)
    first.connection.resume_reading()
    found = await first.receive_until_step(begin + _AHEAD)
    steps = {m["step"] for m in found if m["type"] == "state"}
    missing = sorted(set(range(begin + 1, begin + _AHEAD + 1)) - steps)
    check(
        not missing, f"there were no states of {len(missing)} of {_AHEAD} steps, first of step {missing[:1]}"
    )


@case(
    "LCK-2/marks",
    "Check welcome, description and states",
    "lockstep is true in welcome and description; states have a step",
    also=("LCK-1",),
)
async def lockstep_is_announced(ctx: CaseContext) -> None:
    first, second = await join_both(ctx)
    check(first.connection.welcome.get("lockstep") is True, "lockstep is not true in welcome")
    check(ctx.server.description["lockstep"] is True, "lockstep is not true in the description")
    check(first.step >= 0 and second.step >= 0, "states have no step")
