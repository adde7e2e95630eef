"""Admitted motion: increments, bounds, and braking to rest."""

import math
from functools import partial
from typing import Any, Literal, assert_never, get_args

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import check_admitted, entry_of

_SAME = 1e-9
Loss = Literal["release", "again", "takeover", "stop"]
"""Ways to lose a lease."""

_MOST_REASONS = 64
_FAR = 3.0
"""Time for which the kit drives towards a limit, s at the robot's full speed."""


@case(
    "CMD-18/target",
    "Send small commands, one each tick",
    "target is later than the tick of the command; no state before target shows the seq as applied",
    also=("STA-6",),
)
async def target_is_a_later_tick_at_which_the_command_is_applied(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(5):
        verdict = await holder.move(holder.small_increment(0.2))
        check(verdict["target"] > verdict["tick"], f"target {verdict['target']} for tick {verdict['tick']}")
        state = await holder.state_applying(verdict)
        check(
            state["tick"] >= verdict["target"],
            f"applied at {state['tick']}, before its target {verdict['target']}",
        )


@case(
    "CMD-20/admitted",
    "Send a small increment",
    "admitted: dq as commanded, beta 1, no reasons",
    also=("CMD-23",),
)
async def small_increment_is_admitted_unchanged(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for share in (0.0, 0.5, 1.0):
        wanted = holder.small_increment(share)
        verdict = await holder.command(wanted)
        check_admitted(verdict)
        off = max(abs(a - b) for a, b in zip(verdict["dq"], wanted, strict=True))
        check(off <= _SAME, f"admitted, but dq differs from the command by {off}")
        check(
            verdict["beta"] == 1.0 and not verdict.get("reasons"),
            f"beta {verdict['beta']}, {verdict.get('reasons')}",
        )


_EXCESSIVE: dict[str, tuple[str, float]] = {
    "step": ("ten times the largest one", 25.0),
    "huge": ("1e300", 1e300),
}


async def excessive_increment_is_limited(ctx: CaseContext, factor: float) -> None:
    holder = await ctx.holder()
    wanted = [
        math.copysign(factor, x) if factor > 1e9 and x else factor * x for x in holder.small_increment()
    ]
    verdict = await holder.command(wanted)
    check(verdict["outcome"] == "limited", f"it was {verdict['outcome']}")
    check(
        verdict["dq"] != wanted and verdict["beta"] > 0,
        f"limited to {verdict['dq']} with beta {verdict['beta']}",
    )
    check(bool(verdict.get("reasons")), "limited without a reason")
    for reason in verdict["reasons"]:
        if reason["cause"] in ("increment", "acceleration"):
            named = [reason.get(key) for key in ("joint", "value", "bound")]
            check(None not in named, f"{reason['cause']} names joint, value and bound {named}")


for _slug, (_what, _factor) in _EXCESSIVE.items():
    case(
        f"CMD-21/{_slug}",
        f"Command an increment of {_what}",
        "limited: another dq, beta above 0, a reason with joint, value and bound; the robot stays within its bounds",
        also=("CMD-19", "CMD-25", "CMD-27"),
    )(partial(excessive_increment_is_limited, factor=_factor))


@case(
    "CMD-38/joints",
    "Command 1e308 for every joint, then -1e308",
    "Each joint is named in a reason; if there are more than 64 reasons, 64 are listed and the others counted",
    also=("CMD-19",),
)
async def every_limiting_joint_is_named(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    names = {joint["name"] for joint in ctx.server.robot["joints"]}
    for wanted in (1e308, -1e308):
        reasons = (await holder.command([wanted] * holder.n)).get("reasons") or []
        if len(reasons) < _MOST_REASONS:
            missing = names - {reason.get("joint") for reason in reasons}
            check(not missing, f"no reason names {sorted(missing)}, although no joint can move so fast")
        else:
            check(len(reasons) == _MOST_REASONS, f"a verdict has {len(reasons)} reasons")
            text = reasons[-1]["text"]
            check(any(map(str.isdigit, text)), f"the last reason does not count the omitted ones: {text}")


@case(
    "CMD-19/acceleration",
    "At rest, command the full speed at once",
    "limited by acceleration or increment; the robot accelerates within its bound",
    also=("CMD-21", "CMD-25", "CMD-37"),
)
async def acceleration_from_rest_is_limited(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    joints, period = ctx.server.robot["joints"], ctx.server.robot["period"]
    wanted = [
        math.copysign(j["velocity"] * period, x) if x else 0.0
        for j, x in zip(joints, holder.small_increment(), strict=True)
    ]
    verdict = await holder.command(wanted)
    allowed = [j["acceleration"] * period**2 for j in joints]
    over = [i for i, d in enumerate(verdict["dq"]) if abs(d) > allowed[i] * (1 + 1e-6)]
    check(
        not over,
        f"from rest joints {over} are admitted with {verdict['dq']}; the acceleration allows {allowed}",
    )
    if any(abs(w) > a * (1 + 1e-6) for w, a in zip(wanted, allowed, strict=True)):
        causes = [reason["cause"] for reason in verdict.get("reasons", ())]
        check("acceleration" in causes, f"it was {verdict['outcome']} by {causes}, not by acceleration")


@case(
    "CMD-37/turn",
    "Command full speed for eight ticks, then for eight ticks the other way",
    "The robot accelerates, brakes and turns within the bounds of the joint",
    also=("CMD-19",),
)
async def reversal_is_within_the_bounds(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    joints, period = ctx.server.robot["joints"], ctx.server.robot["period"]
    full = [
        math.copysign(j["velocity"] * period, x) if x else 0.0
        for j, x in zip(joints, holder.small_increment(), strict=True)
    ]
    for way in (1.0, -1.0):
        outcomes = [(await holder.command([way * x for x in full]))["outcome"] for _ in range(8)]
        check(set(outcomes) != {"refused"}, "no command was admitted, although the joint has room")


_NUMBERS: dict[str, Any] = {
    "2**63": 2**63,
    "2**64-1": 2**64 - 1,
    "-2**63": -(2**63),
    "max-float": 1.7976931348623157e308,
    "denormal": 5e-324,
    "minus-zero": -0.0,
}


async def unusual_numbers_in_dq_are_treated_as_numbers(ctx: CaseContext, value: Any) -> None:
    holder = await ctx.holder()
    dq = [value if x else 0.0 for x in holder.small_increment()]
    verdict = await holder.command(dq)
    expected = "admitted" if abs(float(value)) < 1e-9 else "limited"
    check(
        verdict["outcome"] in (expected, "refused" if expected == "limited" else expected),
        f"it was {verdict['outcome']}",
    )
    check(all(map(math.isfinite, verdict["dq"])), f"dq is {verdict['dq']}")


for _slug, _value in _NUMBERS.items():
    case(
        f"PAY-13/dq-{_slug.replace('*', 'x')}",
        f"Send a command with {_slug} in dq",
        "It is treated as this number; the robot stays within its bounds",
        also=("CMD-25",),
    )(partial(unusual_numbers_in_dq_are_treated_as_numbers, value=_value))


@case(
    "CMD-22/refused",
    "Provoke refusals by fence, ahead, length and not_finite",
    "Outcome refused, beta 0, one reason, and dq of the plan that the robot plays: zeros, as it rests",
    also=("CMD-17", "CMD-29"),
)
async def refused_command_has_beta_zero_and_a_reason(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    bad: list[Fields] = [{"fence": 10**12}, {"tick": 2**40}, {"dq": []}, {"dq": [math.nan] * holder.n}]
    for more in bad:
        tick = (await holder.next_state())["tick"]
        verdict = await holder.send_command(holder.make_command(tick) | more)
        check(
            verdict["outcome"] == "refused" and verdict["beta"] == 0.0,
            f"{verdict['outcome']} with beta {verdict['beta']}",
        )
        check(len(verdict.get("reasons", ())) == 1, f"reasons: {verdict.get('reasons')}")
        check(list(verdict["dq"]) == [0.0] * holder.n, f"the plan of a resting robot has dq {verdict['dq']}")


@case(
    "CMD-23/setpoint",
    "From rest, send a small increment",
    "setpoint of the verdict is the previous setpoint plus dq",
    also=("CMD-24",),
)
async def verdict_setpoint_is_the_previous_setpoint_plus_dq(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    before = entry_of(await holder.next_state(), ctx.robot)["setpoint"]
    verdict = await holder.move()
    off = max(abs(b + d - s) for b, d, s in zip(before, verdict["dq"], verdict["setpoint"], strict=True))
    check(off <= _SAME, f"setpoint differs from the previous setpoint plus dq by {off}")
    await holder.state_applying(verdict)


@case(
    "CMD-28/rest",
    "Move the robot for ten ticks, then send no more commands",
    "It brakes to rest; applied_seq stays",
    also=("STA-7",),
)
async def robot_without_commands_comes_to_rest(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(10):
        verdict = await holder.move(holder.small_increment(0.6))
    end = entry_of(await holder.state_applying(verdict), ctx.robot).get("stop_end")
    await ctx.wait_at_rest()
    samples = ctx.observer.samples(ctx.robot)
    check(samples[-1].applied == verdict["seq"], f"applied_seq is {samples[-1].applied} at rest")
    if end is not None:
        off = max(abs(a - b) for a, b in zip(end, samples[-1].setpoint, strict=True))
        check(off < 1e-6, f"the robot rests {off} away from the reported stop_end")


@case(
    "CMD-29/refused",
    "Move the robot; then send only commands that are refused",
    "It brakes to rest as without commands",
    also=("CMD-28", "CMD-22"),
)
async def robot_with_refused_commands_comes_to_rest(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(8):
        await holder.move(holder.small_increment(0.6))
    bad: list[Fields] = [
        {"fence": 10**12},
        {"dq": [math.inf] * holder.n},
        {"dq": [0.1] * 60},
        {"tick": 2**40},
    ]
    for _ in range(6):
        for more in bad:
            tick = (await holder.next_state())["tick"]
            verdict = await holder.send_command(
                holder.make_command(tick, [x * 50 for x in holder.small_increment()]) | more
            )
            check(verdict["outcome"] == "refused", f"{more} was {verdict['outcome']}")
    await ctx.wait_at_rest()


@case("CMD-30/zeros", "At rest, send a command of zeros", "admitted")
async def zeros_at_rest_are_admitted(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    await ctx.wait_at_rest()
    check_admitted(await holder.command([0.0] * holder.n))


async def every_seq_is_accepted(ctx: CaseContext, make: Any) -> None:
    holder = await ctx.holder()
    for seq in make(next(holder.connection.commands.seqs) + 1):
        tick = (await holder.next_state())["tick"]
        # Commands without effect, so that no later case finds an unknown seq applied.
        await holder.send_command(holder.make_command(tick, [], seq=seq))
    for _ in range(10):
        next(holder.connection.commands.seqs)


for _slug, (_what, _make) in {
    "same": ("repeated", lambda seq: [seq, seq]),
    "falling": ("decreasing", lambda seq: [seq + 5, seq + 4, seq + 3]),
    "largest": ("the largest possible, then 0", lambda seq: [2**63 - 1, 0]),
}.items():
    case(f"CMD-31/{_slug}", f"Send commands whose seq is {_what}", "Each gets its verdict")(
        partial(every_seq_is_accepted, make=_make)
    )


@case(
    "CMD-33/reserved",
    "Send a command with a past deadline and a horizon of 0",
    "Same verdict as without them",
)
async def deadline_and_horizon_have_no_effect(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    check_admitted(await holder.command(deadline=-1e9, horizon=0))
    check_admitted(await holder.command(deadline=None, horizon=None))


# --- bounds -----------------------------------------------------------------------------------------------


async def drive(ctx: CaseContext, joint: int, sign: float) -> set[str]:
    """Drive one joint at full speed until it stops, and return all causes named.

    Raises:
        Skip: It does not stop in time.
    """
    holder = await ctx.holder()
    bounds, period = ctx.server.robot["joints"][joint], ctx.server.robot["period"]
    wanted = [sign * bounds["velocity"] * period if i == joint else 0.0 for i in range(holder.n)]
    named: set[str] = set()
    still = 0
    for _ in range(int(_FAR / period)):
        verdict = await holder.command(wanted)
        for reason in verdict.get("reasons", ()):
            named.add(reason["cause"])
            pair = reason["cause"] != "clearance" or reason.get("pair")
            check(bool(pair), f"clearance without the pair of bodies: {reason}")
        still = still + 1 if not any(verdict["dq"]) else 0
        if still > 3:
            return named
    raise Skip(f"joint {bounds['name']} is not limited within {_FAR:g} s of full speed")


@case(
    "CMD-26/limit",
    "Drive the joint that is nearest to one of its limits into it, at full speed",
    "It stops at or before the limit; joint_limit or clearance is named",
    also=("CMD-19", "CMD-22"),
)
async def robot_stops_at_a_joint_limit(ctx: CaseContext) -> None:
    joints = ctx.server.robot["joints"]
    entry_: Any = ctx.entry()
    rooms = [(side * (j["upper" if side > 0 else "lower"] - q) / j["velocity"], i, side) for i, (j, q) in enumerate(zip(joints, entry_["setpoint"], strict=True)) for side in (1.0, -1.0)]  # fmt: skip
    _, joint, side = min(rooms)
    named = await drive(ctx, joint, side)
    check(bool(named & {"joint_limit", "clearance"}), f"it stopped, but the causes were {sorted(named)}")


@case(
    "CMD-36/clearance",
    "Drive the first joint at full speed, up to 3 s, in both directions",
    "If a clearance limits it, the robot stops before the obstacle and the verdict names the pair",
    also=("CMD-19", "CMD-27"),
)
async def robot_stops_before_an_obstacle(ctx: CaseContext) -> None:
    for sign in (1.0, -1.0):
        try:
            named = await drive(ctx, 0, sign)
        except Skip:
            named = set()
        for client in ctx.connections:
            client.close()
        await ctx.wait_free()
        if "clearance" in named:
            return
    raise Skip("there is no obstacle for the first joint")


@case(
    "CMD-35/former",
    "Lose the lease in four ways; command with its fence each time",
    "Refused each time; the robot does not move",
    also=("CMD-8", "CMD-9"),
)
async def former_holder_cannot_move_the_robot(ctx: CaseContext) -> None:
    client = await ctx.operator()
    ways: tuple[Loss, ...] = get_args(Loss)
    for way in ways:
        holder = await ctx.holder(name=way)
        match way:
            case "release":
                await holder.connection.call("release", "lease", robot=ctx.robot, fence=holder.fence)
            case "again":
                await holder.connection.call("acquire", "lease", robot=ctx.robot)
            case "takeover":
                await client.call("acquire", "lease", robot=ctx.robot, takeover=True)
            case "stop":
                await client.call("stop", "stopped", robot=ctx.robot)
            case _:
                assert_never(way)
        for _ in range(3):
            verdict = await holder.command(forbidden=f"the lease ended by {way}")
            check(
                verdict["outcome"] == "refused",
                f"after {way} a command with the old fence was {verdict['outcome']}",
            )
        if way == "again":
            holder.connection.close()
            await ctx.wait_free()
        if way == "takeover":
            client.close()
            await ctx.wait_free()
            client = await ctx.operator()


@case(
    "STA-16/clock",
    "Send commands, then none, and garbage: count ticks over half a second",
    "The robot's clock keeps its period",
)
async def clock_of_the_robot_is_undisturbed(ctx: CaseContext) -> None:
    period = ctx.server.robot["period"]
    client = await ctx.client()
    begin = await client.call("ping", "pong", time=0.0)
    first = ctx.observer.tick(ctx.robot)
    holder = await ctx.holder()
    for _ in range(10):
        await holder.move(holder.small_increment(0.2))
        odd = await ctx.connect("odd")
        odd.send_bytes(b"\x00\x00\x00\x01\xc1", "garbage")
    await ctx.observer.ticks(ctx.robot, max(10, int(0.5 / period)))
    end = await client.call("ping", "pong", time=0.0)
    ticks, seconds = ctx.observer.tick(ctx.robot) - first, end["received"] - begin["received"]
    # States and pongs have delays of their own, so only the long run counts.
    check(
        abs(ticks * period - seconds) < 0.25 + 0.1 * seconds + ctx.target.faults.delay,
        f"{ticks} ticks of {period} s in {seconds:.3f} s",
    )
