"""Commands that are refused before the gate decides: the order of checks, and the free slot of the tick."""

import math
from functools import partial
from typing import Any

from armgate.conformance.case import Skip, Violation, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import cause_of, check_admitted, check_refused, send_together

_TRIES = 20


@case(
    "CMD-8/nobody",
    "Command a robot that no client holds, with the fence of the last lease",
    "Refused by lease",
    also=("CMD-17",),
)
async def command_of_a_free_robot_is_refused_by_lease(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    await holder.connection.call("release", "lease", robot=ctx.robot, fence=holder.fence)
    for fence in (holder.fence, holder.fence + 1, 0):
        check_refused(await holder.command(fence=fence, forbidden="no client holds the robot"), "lease")


_FENCES = {"old": -1, "next": +1, "far": 10**12}


async def command_with_another_fence_is_refused_by_fence(ctx: CaseContext, by: int) -> None:
    holder = await ctx.holder()
    bad, good = await send_together(
        holder,
        lambda tick: holder.forbid(
            holder.make_command(tick, fence=max(0, holder.fence + by)), "another fence"
        ),
        holder.make_command,
    )
    check_refused(bad, "fence")
    check_admitted(good)


for _slug, _by in _FENCES.items():
    case(
        f"CMD-9/{_slug}",
        f"Send a command with the fence of the lease {_by:+}",
        "Refused by fence; the slot stays free",
        also=("CMD-17",),
    )(partial(command_with_another_fence_is_refused_by_fence, by=_by))


@case(
    "CMD-9/stolen",
    "Another session commands with the holder's fence, while the robot moves and afterwards",
    "Refused by fence: the fence without the lease does not allow commands",
)
async def command_with_the_holders_fence_is_refused_from_another_session(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    other = await ctx.client(name="other")
    for _ in range(5):
        tick = (await holder.next_state())["tick"]
        copied = holder.forbid(holder.make_command(tick), "its sender is not the holder")
        other.send(copied)
        check_refused(await other.expect("verdict", seq=copied["seq"]), "fence")
    await holder.move()


@case(
    "CMD-10/stopped",
    "Stop the robot while it moves; its holder continues to send commands",
    "Refused by lease or by stopped; the robot comes to rest",
    also=("STP-4", "CMD-35"),
)
async def command_of_a_stopped_robot_is_refused(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(5):
        await holder.move()
    other = await ctx.client("observer", "other")
    await other.call("stop", "stopped", robot=ctx.robot)
    for _ in range(5):
        verdict = await holder.command(forbidden="the robot is stopped")
        check(
            verdict["outcome"] == "refused" and cause_of(verdict) in ("lease", "stopped"),
            f"it was {verdict['outcome']} by {cause_of(verdict)}",
        )
    await ctx.wait_at_rest()


@case(
    "CMD-11/link",
    "Command a robot whose link is not ready, if the cell has one",
    "Refused by link; the slot stays free",
    also=("CMD-7",),
)
async def command_without_a_ready_link_is_refused_by_link(ctx: CaseContext) -> None:
    out = next(filter(ctx.link_not_ready, (r["name"] for r in ctx.server.description["robots"])), None)
    if out is None:
        raise Skip("the links of all robots are ready")
    holder = await ctx.holder(robot=out)
    command = holder.forbid(holder.make_command(0, [0.0] * holder.n), "its link is not ready")
    check_refused(await holder.send_command(command), "link")


async def command_based_on_a_future_tick_is_refused_by_ahead(ctx: CaseContext, ahead: int) -> None:
    holder = await ctx.holder()
    for _ in range(_TRIES):
        # The next tick may happen before the verdict: then the command was not ahead.
        bad, good = await send_together(
            holder, lambda tick: holder.make_command(tick + ahead), holder.make_command
        )
        if ahead > 1 or cause_of(bad) == "ahead":
            check_refused(bad, "ahead")
            return check_admitted(good)
    raise Violation(f"a command one tick ahead was never refused; the last time: {bad['outcome']}")


for _slug, _ahead in {"next": 1, "far": 1000, "huge": 2**62}.items():
    case(
        f"CMD-12/{_slug}",
        f"Send a command based on a tick {_ahead} ahead",
        "Refused by ahead; the slot stays free",
        also=("CMD-17",),
    )(partial(command_based_on_a_future_tick_is_refused_by_ahead, ahead=_ahead))


@case(
    "CMD-13/stale",
    "Send a command based on a tick that is one older than max_age_ticks allows, and one based on tick 0",
    "Refused by stale; the slot stays free",
    also=("CMD-17",),
)
async def command_based_on_an_old_tick_is_refused_by_stale(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    age = ctx.server.max_age + 1
    if ctx.observer.tick(ctx.robot) <= age:
        await ctx.observer.ticks(ctx.robot, age)
    bad, good = await send_together(
        holder,
        lambda tick: holder.forbid(holder.make_command(tick - age), "its tick is too old"),
        holder.make_command,
    )
    check_refused(bad, "stale")
    check_admitted(good)
    check_refused(await holder.send_command(holder.make_command(0)), "stale")


@case(
    "CMD-13/just", "Send a command based on the oldest tick that max_age_ticks allows", "Not refused by stale"
)
async def command_of_the_largest_age_is_not_stale(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    await ctx.observer.until(lambda: ctx.observer.tick(ctx.robot) > ctx.server.max_age, "enough ticks")
    for _ in range(2 * _TRIES):
        tick = (await holder.next_state())["tick"]
        verdict = await holder.send_command(holder.make_command(tick - ctx.server.max_age))
        if cause_of(verdict) != "stale":
            return
    raise Violation("it was refused by stale every time, although the newest tick had just come")


@case(
    "CMD-14/double",
    "Send two commands for one tick in one write",
    "The second is refused by occupied; the first is applied",
    also=("CMD-17", "CMD-18"),
)
async def second_command_of_a_tick_is_refused_by_occupied(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    first, second = await send_together(
        holder, holder.make_command, lambda tick: holder.make_command(tick, [0.0] * holder.n), good=0
    )
    for _ in range(_TRIES):
        if cause_of(second) is not None:
            break
        first, second = await send_together(
            holder, holder.make_command, lambda tick: holder.make_command(tick, [0.0] * holder.n), good=0
        )
    check_admitted(first)
    check_refused(second, "occupied")
    await holder.state_applying(first)


@case(
    "CMD-14/after-refusal-by-gate",
    "Send a command that the gate limits, then another for the tick",
    "The first command has the slot: the second one is refused by occupied",
    also=("CMD-18",),
)
async def command_after_a_limited_one_is_refused_by_occupied(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    huge = [1e6 * x for x in holder.small_increment()]
    for _ in range(_TRIES):
        first, second = await send_together(
            holder, lambda tick: holder.make_command(tick, huge), holder.make_command, good=0
        )
        check(first["target"] is not None, f"the first has no target: {first}")
        if cause_of(second) == "occupied":
            return
    raise Violation(f"the second was never refused by occupied; the last time it was {second['outcome']}")


_LENGTHS: dict[str, int] = {"short": -1, "long": 1, "empty": -64, "64": 64}
_DQS = {
    "short": "a dq that is one number too short",
    "long": "a dq that is one number too long",
    "empty": "an empty dq",
    "64": "a dq of 64 numbers",
}


async def command_of_another_length_is_refused_by_length(ctx: CaseContext, by: int) -> None:
    holder = await ctx.holder()
    count = 64 if by == 64 else max(0, holder.n + by)
    if count == holder.n:
        raise Skip(f"the robot has {count} joints")
    bad, good = await send_together(
        holder,
        lambda tick: holder.forbid(holder.make_command(tick, [0.0] * count), "its dq has another length"),
        holder.make_command,
    )
    check_refused(bad, "length")
    check_admitted(good)


for _slug, _by in _LENGTHS.items():
    case(
        f"CMD-15/{_slug}",
        f"Send a command with {_DQS[_slug]}",
        "Refused by length; the slot stays free",
        also=("CMD-17",),
    )(partial(command_of_another_length_is_refused_by_length, by=_by))


async def command_with_a_non_finite_number_is_refused(ctx: CaseContext, value: float) -> None:
    holder = await ctx.holder()

    def with_value(joint: int, tick: int) -> Fields:
        dq = [value if i == joint else 0.0 for i in range(holder.n)]
        return holder.forbid(holder.make_command(tick, dq), "its dq is not finite")

    for joint in (0, holder.n - 1):
        bad, good = await send_together(
            holder, partial(with_value, joint), lambda tick: holder.make_command(tick, [0.0] * holder.n)
        )
        check_refused(bad, "not_finite")
        check(good["outcome"] != "refused", f"the slot was not free: {good.get('reasons')}")


for _slug, _value in {"nan": math.nan, "infinity": math.inf, "minus-infinity": -math.inf}.items():
    case(
        f"CMD-16/{_slug}",
        f"Send a command with {_value} in dq, at the first and at the last joint",
        "Refused by not_finite; the slot stays free; nothing moves",
        also=("CMD-17", "PAY-16"),
    )(partial(command_with_a_non_finite_number_is_refused, value=_value))


_PRECEDENCE: dict[str, tuple[str, str, dict[str, Any]]] = {
    "fence-ahead": ("fence", "another fence, a tick ahead", {"fence": 10**12, "tick": 2**40}),
    "fence-length": ("fence", "another fence and a wrong length", {"fence": 10**12, "dq": [0.0] * 60}),
    "ahead-length": ("ahead", "a tick ahead and a wrong length", {"tick": 2**40, "dq": [0.0] * 60}),
    "stale-length": ("stale", "tick 0 and a wrong length", {"tick": 0, "dq": [0.0] * 60}),
    "stale-nan": ("stale", "tick 0 and NaN", {"tick": 0, "dq": "nan"}),
    "length-nan": ("length", "a wrong length and NaN", {"dq": [math.nan] * 60}),
}


async def first_failed_check_names_the_cause(ctx: CaseContext, expected: str, more: dict[str, Any]) -> None:
    holder = await ctx.holder()
    await ctx.observer.until(lambda: ctx.observer.tick(ctx.robot) > ctx.server.max_age, "enough ticks")
    fields = more | ({"dq": [math.nan] * holder.n} if more.get("dq") == "nan" else {})
    for _ in range(_TRIES):
        tick = (await holder.next_state())["tick"]
        verdict = await holder.send_command(holder.make_command(tick) | fields)
        if cause_of(verdict) == expected or cause_of(verdict) != "stale":
            break
    check_refused(verdict, expected)


for _slug, (_cause, _what, _more) in _PRECEDENCE.items():
    case(
        f"CMD-7/{_slug}",
        f"Send a command with {_what}",
        f"Refused by {_cause}, the first in the order of the checks",
        also=("CMD-17",),
    )(partial(first_failed_check_names_the_cause, expected=_cause, more=_more))


@case(
    "CMD-7/occupied-length",
    "For one tick, send a valid command and then a command of wrong length",
    "The second is refused by occupied",
)
async def occupied_is_checked_before_the_length(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(_TRIES):
        first, second = await send_together(
            holder, holder.make_command, lambda tick: holder.make_command(tick, [0.0] * 60), good=0
        )
        if cause_of(second) != "length":
            break
    check_admitted(first)
    check_refused(second, "occupied")
