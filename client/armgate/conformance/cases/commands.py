"""Commands and their verdicts: one verdict per command, in order, to the sender."""

import math
from functools import partial
from typing import Any

from armgate.conformance.case import Violation, case, check
from armgate.conformance.codec import pack
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import cause_of, check_admitted, check_refused, entry_of

_SAME = 1e-9
_TRIES = 20


@case(
    "CMD-1/one",
    "Send 20 commands, one each tick, and a ping",
    "20 verdicts, one per command, only to the sender",
)
async def every_command_gets_one_verdict(ctx: CaseContext) -> None:
    other = await ctx.client("operator", "other")
    holder = await ctx.holder()
    for i in range(20):
        await holder.command(holder.small_increment(0.5) if i < 10 else [0.0] * holder.n)
    await holder.connection.sync()
    extra = [m for m in holder.connection.inbox if m["type"] == "verdict"]
    check(not extra, f"more verdicts than commands: {extra}")
    await other.sync()
    check(not any(m["type"] == "verdict" for m in other.inbox), "another session received a verdict")


@case("CMD-1/observer", "Send a command as observer", "One verdict, refused by lease", also=("CMD-8",))
async def command_of_an_observer_is_refused_by_lease(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    command = {
        "robot": ctx.robot,
        "fence": 1,
        "seq": next(client.commands.seqs),
        "tick": 0,
        "dq": [0.0] * ctx.n,
    }
    client.send({"type": "command", **command})
    check_refused(await client.expect("verdict", seq=command["seq"]), "lease")


@case("CMD-2/echo", "Send commands that are admitted and refused", "Verdicts repeat robot, seq and tick")
async def verdict_repeats_robot_seq_and_tick(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for more in ({}, {"fence": holder.fence + 7}, {"dq": [math.nan] * holder.n}):
        tick = (await holder.next_state())["tick"]
        command = holder.make_command(tick, **more)
        verdict = await holder.send_command(command)
        for key in ("robot", "seq", "tick"):
            check(verdict[key] == command[key], f"{key} is {verdict[key]}; the command has {command[key]}")


@case(
    "CMD-3/order",
    "Send 30 commands in one write: valid, invalid and repeated ones",
    "30 verdicts in the order of the commands",
    also=("CMD-1",),
)
async def verdicts_come_in_the_order_of_the_commands(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    tick = (await holder.next_state())["tick"]
    dqs = [None, [0.0], [math.inf] * holder.n]
    commands = [holder.make_command(tick + i % 3 * 1000, dqs[i % 3]) for i in range(30)]
    holder.connection.send(*commands)
    for command in commands:
        await holder.connection.expect("verdict", seq=command["seq"])


@case(
    "CMD-4/before-state",
    "Move ten ticks, watching states on the same connection",
    "Every verdict comes before the state that applies it",
    also=("STA-6", "CMD-24"),
)
async def verdict_comes_before_the_state_that_applies_it(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(10):
        verdict = await holder.move(holder.small_increment(0.3))
        state = await holder.state_applying(verdict)
        shown = entry_of(state, ctx.robot)
        if shown["tick"] == verdict["target"]:
            off = max(abs(a - b) for a, b in zip(shown["setpoint"], verdict["setpoint"], strict=True))
            check(off <= _SAME, f"the setpoint at the target differs from the verdict's by {off}")


@case(
    "CMD-5/unknown-robot",
    "Command a robot that the cell does not have",
    "An error unknown_robot with its seq, no verdict",
    also=("ERR-7",),
)
async def command_of_an_unknown_robot_is_an_error(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    tick = (await holder.next_state())["tick"]
    command = holder.make_command(tick, robot="kit-no-robot")
    holder.connection.send(command)
    await holder.connection.expect("error", code="unknown_robot", seq=command["seq"], fatal=False)
    await holder.move()


_UNREADABLE: dict[str, tuple[str, dict[str, Any]]] = {
    "text": ("a text in dq", {"dq": ["0.1", 0.0, 0.0]}),
    "bool": ("a bool in dq", {"dq": [True, 0.0, 0.0]}),
    "nil": ("nil in dq", {"dq": [None, 0.0, 0.0]}),
    "map": ("a map for dq", {"dq": {"0": 0.1}}),
    "nested": ("arrays in dq", {"dq": [[0.1], [0.0], [0.0]]}),
    "missing": ("no dq", {"dq": None}),
    "too-many": ("65 numbers in dq", {"dq": [0.0] * 65}),
    "tick-text": ("a text for tick", {"tick": "5"}),
    "tick-real": ("a fraction for tick", {"tick": 5.5}),
    "tick-negative": ("a negative tick", {"tick": -1}),
    "fence-bool": ("a bool for fence", {"fence": True}),
    "fence-huge": ("2**64 - 1 for fence", {"fence": 2**64 - 1}),
    "robot-number": ("a number for robot", {"robot": 7}),
}  # fmt: skip


async def unreadable_command_is_an_error_with_its_seq(ctx: CaseContext, more: dict[str, Any]) -> None:
    holder = await ctx.holder()
    for _ in range(_TRIES):
        tick = (await holder.next_state())["tick"]
        bad, good = holder.make_command(tick) | more, holder.make_command(tick)
        holder.connection.send_bytes(pack(bad), f"unreadable: {bad}")
        holder.connection.send(good)
        error = await holder.connection.expect("error", code="invalid_message", fatal=False, about="command")
        check(
            error.get("seq") == bad["seq"],
            f"the error names seq {error.get('seq')}; the command has {bad['seq']}",
        )
        verdict = await holder.connection.expect("verdict", seq=good["seq"])
        if cause_of(verdict) != "stale":
            return check_admitted(verdict)
    raise Violation("the valid command came too late every time")


for _slug, (_what, _more) in _UNREADABLE.items():
    case(
        f"CMD-6/{_slug}",
        f"Send a command with {_what}, followed by a valid command",
        "An error invalid_message with the seq of the first and no verdict; the second gets the slot",
        also=("ERR-4", "ERR-7", "PAY-14"),
    )(partial(unreadable_command_is_an_error_with_its_seq, more=_more))


@case(
    "CMD-6/no-seq",
    "Send a command without seq",
    "An error invalid_message without seq; the connection stays open",
)
async def command_without_seq_is_an_error_without_seq(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    bad = holder.make_command((await holder.next_state())["tick"])
    del bad["seq"]
    holder.connection.send_bytes(pack(bad), f"without seq: {bad}")
    error = await holder.connection.expect("error", code="invalid_message", fatal=False, about="command")
    check(error.get("seq") is None, f"the error names seq {error.get('seq')}")
    await holder.move()
