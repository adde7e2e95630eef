"""Stops and resets."""

import math
import re
from functools import partial

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import entry_of, state_after_now

_ACCURACY = 1e-3
"""Largest difference between setpoint and measured position that the accuracy of a measurement explains, rad or m."""


async def next_broadcast(client: Connection, kind: str) -> Fields:
    """Return the next broadcast of a type."""
    return await client.receive(lambda m: m["type"] == kind, kind)


async def every_role_may_stop_the_cell(ctx: CaseContext, role: str) -> None:
    holder = await ctx.holder()
    for _ in range(8):
        await holder.move(holder.small_increment(0.8))
    client = await ctx.client(role, "stopper")
    answer = await client.call("stop", "stopped", reason="a case of the kit")
    names = [robot["name"] for robot in ctx.server.description["robots"]]
    check(sorted(answer["robots"]) == sorted(names), f"the stop is for {answer['robots']}")
    check((answer["by"], answer["reason"]) == (ctx.name("stopper"), "a case of the kit"), f"{answer}")
    await ctx.wait_at_rest()
    await ctx.observer.ticks(ctx.robot, 5)


for _role in ("observer", "controller", "operator"):
    case(
        f"STP-1/{_role}",
        f"As {_role}, stop the cell while the robot moves",
        "stopped, with all robots; the robot brakes to rest and stays there",
        also=("STP-4", "STP-2", "MSG-9"),
    )(partial(every_role_may_stop_the_cell, role=_role))


@case(
    "STP-2/everybody",
    "Stop the robot; check what three other sessions receive",
    "Each receives stopped once, the requester as an answer",
    also=("MSG-5",),
)
async def stop_is_broadcast_once_to_all(ctx: CaseContext) -> None:
    others = [await ctx.client(role, role) for role in ("observer", "controller", "operator")]
    requester = await ctx.client(name="requester")
    answer = await requester.call("stop", "stopped", robot=ctx.robot, reason="broadcast")
    for client in others:
        received = await next_broadcast(client, "stopped")
        same = {key: received[key] for key in ("stop", "robots", "reason", "by")}
        check(same == {key: answer[key] for key in same}, f"one received {received}, the requester {answer}")
        check(received.get("re") is None, f"a session without a request received re {received.get('re')}")
    for client in (*others, requester):
        await client.sync()
        check(not any(m["type"] == "stopped" for m in client.inbox), "stopped was sent twice")


@case("STP-3/ids", "Stop five times", "Each stop has a larger id than the one before", also=("STP-7",))
async def stop_ids_grow(ctx: CaseContext) -> None:
    client = await ctx.client()
    ids = [(await client.call("stop", "stopped", robot=ctx.robot))["stop"] for _ in range(5)]
    check(ids == sorted(set(ids)), f"the ids were {ids}")


@case(
    "STP-5/lease",
    "Stop a robot that is held",
    "Its holder receives stopped first, then lease lost",
    also=("LEA-17",),
)
async def stop_is_announced_before_the_lost_lease(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    other = await ctx.client(name="other")
    await other.call("stop", "stopped", robot=ctx.robot)
    received = [m for m in await holder.connection.drain() if m["type"] in ("stopped", "lease")]
    kinds = [m["type"] for m in received]
    check(kinds == ["stopped", "lease"], f"the holder received {kinds}")
    lost = received[1]
    check((lost["state"], lost["fence"]) == ("lost", holder.fence), f"the lease is {lost}")


@case(
    "LEA-23/named",
    "Stop a robot that is held; command it and acquire it",
    "Verdict and error name the id of the stop in their texts",
    also=("CMD-8", "LEA-10"),
)
async def refusals_by_a_stop_name_its_id(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    other = await ctx.client(name="other")
    # Twelve stops, so that the id has two digits, which no other number in the texts is likely to have.
    for number in range(12):
        stop = (await other.call("stop", "stopped", robot=ctx.robot, reason=f"{number}"))["stop"]
    verdict = await holder.command(forbidden="the robot is stopped")
    text = " ".join(reason["text"] for reason in verdict["reasons"])
    check(str(stop) in re.findall(r"\d+", text), f"the verdict does not name stop {stop}: {text}")
    error = await other.request("acquire", robot=ctx.robot)
    check(error.get("code") == "stopped", f"acquire was answered by {error}")
    check(str(stop) in re.findall(r"\d+", error["text"]), f"stop {stop} is not named: {error['text']}")


@case(
    "STP-6/others",
    "Hold and move another robot while this one is stopped",
    "Its lease stays, and its commands are admitted",
)
async def stop_of_one_robot_leaves_others(ctx: CaseContext) -> None:
    holder = await ctx.holder(robot=ctx.other_robot())
    await holder.move()
    client = await ctx.client(name="stopper")
    answer = await client.call("stop", "stopped", robot=ctx.robot)
    check(answer["robots"] == [ctx.robot], f"the stop is for {answer['robots']}")
    await holder.move()
    await holder.move()


async def reset_of_an_unknown_stop_is_refused(ctx: CaseContext, stop: int | None) -> None:
    client = await ctx.operator()
    if stop is None:
        stop = (await client.call("stop", "stopped", robot=ctx.robot))["stop"]
        await ctx.wait_at_rest()
        await ctx.reset_stop(client, stop)
    await client.expect_refusal("reset", "unknown_stop", stop=stop)


for _slug, _stop in {"never": 2**62, "lifted": None}.items():
    case(
        f"STP-9/{_slug}",
        "Reset a stop that is not in force" + (": it was reset before" if _stop is None else ""),
        "An error unknown_stop, not fatal",
        also=("ERR-2",),
    )(partial(reset_of_an_unknown_stop_is_refused, stop=_stop))


@case(
    "STP-10/moving",
    "Accelerate, stop, and reset at once",
    "An error moving; the stop stays in force; a reset at rest is answered by resumed",
    also=("STP-4",),
)
async def reset_while_the_robot_moves_is_refused(ctx: CaseContext) -> None:
    holder = await ctx.holder("operator")
    joints, period = ctx.server.robot["joints"], ctx.server.robot["period"]
    wanted = [
        math.copysign(j["velocity"] * period, x) if x else 0.0
        for j, x in zip(joints, holder.small_increment(), strict=True)
    ]
    for _ in range(12):
        await holder.command(wanted)
    stop = (await holder.connection.call("stop", "stopped", robot=ctx.robot))["stop"]
    answer = await holder.connection.request("reset", stop=stop)
    if answer["type"] == "resumed":
        raise Skip("the robot was at rest before the reset came")
    check(
        (answer["type"], answer.get("code"), answer.get("fatal")) == ("error", "moving", False),
        f"got {answer}",
    )
    await ctx.observer.until(lambda: stop in ctx.observer.stops(), "the stop to be seen")
    await ctx.wait_at_rest()
    await ctx.reset_stop(holder.connection, stop)


@case(
    "STP-11/told",
    "Stop and reset; check what another session receives",
    "resumed with the id and the name of the operator, without re",
    also=("MSG-5",),
)
async def reset_is_broadcast_to_all(ctx: CaseContext) -> None:
    other = await ctx.client("observer", "other")
    client = await ctx.operator()
    stop = (await client.call("stop", "stopped", robot=ctx.robot))["stop"]
    await ctx.wait_at_rest()
    answer = await ctx.reset_stop(client, stop)
    received = await next_broadcast(other, "resumed")
    for one in (answer, received):
        check((one["stop"], one["by"]) == (stop, ctx.name("operator")), f"the message is {one}")
    check(received.get("re") is None, "the other session received re")


@case(
    "STP-12/two",
    "Stop the cell and the robot; reset one of the stops",
    "The robot stays stopped until the other stop is reset",
    also=("LEA-10",),
)
async def robot_stays_stopped_until_all_its_stops_are_reset(ctx: CaseContext) -> None:
    client = await ctx.operator()
    first = (await client.call("stop", "stopped"))["stop"]
    second = (await client.call("stop", "stopped", robot=ctx.robot))["stop"]
    await ctx.wait_at_rest()
    await ctx.reset_stop(client, first)
    await client.expect_refusal("acquire", "stopped", robot=ctx.robot)
    await ctx.reset_stop(client, second)
    await client.call("acquire", "lease", robot=ctx.robot)


@case(
    "STP-13/anew",
    "Stop a robot that is held and moves, reset, command with the old fence, acquire it again, move",
    "The old fence is refused; the setpoint is the measured position within 0.001; then it moves",
    also=("CMD-35",),
)
async def robot_is_acquired_again_after_a_reset(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(6):
        await holder.move(holder.small_increment(0.5))
    operator = await ctx.operator()
    stop = (await operator.call("stop", "stopped", robot=ctx.robot))["stop"]
    await ctx.wait_at_rest()
    await ctx.reset_stop(operator, stop)
    verdict = await holder.command(forbidden="its lease ended by the stop")
    check(verdict["outcome"] == "refused", f"a command with the old fence was {verdict['outcome']}")
    shown = entry_of(await state_after_now(holder.connection, ctx.robot), ctx.robot)
    check(shown["holder"] is None, f"after the reset {shown['holder']} holds the robot")
    off = max(abs(a - b) for a, b in zip(shown["q"], shown["setpoint"], strict=True))
    check(off < _ACCURACY, f"the setpoint differs from the measured position by {off}")
    again = await ctx.holder(name="again")
    await again.move()


@case(
    "STP-15/again",
    "Stop a robot twice with one reason, and once with another",
    "The second stop replaces the first, and the third replaces none; states list the second and the third",
)
async def stop_with_the_same_reason_replaces_the_previous_one(ctx: CaseContext) -> None:
    client = await ctx.client()
    answers = [await client.call("stop", "stopped", robot=ctx.robot, reason=reason) for reason in "aab"]
    first, second, third = (one["stop"] for one in answers)
    replaced = [one.get("replaces") for one in answers]
    check(replaced == [None, first, None], f"the stops {first}, {second}, {third} replace {replaced}")
    await ctx.observer.until(lambda: third in ctx.observer.stops(), "the stops to be seen")
    seen = sorted(ctx.entry()["stops"])  # type: ignore[call-overload]
    check(seen == [second, third], f"the stops in force are {seen}")


@case(
    "STP-16/many",
    "Stop a robot and the cell a hundred times each, each with another reason, then reset them all",
    "Each stop is answered; states list at most 64; after all are reset, the robot is free",
    also=("CON-9",),
)
async def number_of_stops_in_force_is_limited(ctx: CaseContext) -> None:
    client = await ctx.operator()
    for number in range(100):
        await client.call("stop", "stopped", robot=ctx.robot, reason=f"{number}")
        last = await client.call("stop", "stopped", reason=f"{number}")
    await ctx.observer.until(lambda: last["stop"] in ctx.observer.stops(), "the stops to be seen")
    seen = sorted(ctx.entry()["stops"])  # type: ignore[call-overload]
    check(len(seen) <= 64, f"{len(seen)} stops are in force")
    await ctx.wait_at_rest()
    for stop in seen:
        await ctx.reset_stop(client, stop)
    await client.call("acquire", "lease", robot=ctx.robot)


@case(
    "STP-17/replaced",
    "Stop a robot three times with one reason, and reset the first of the stops",
    "resumed, with the third stop as lifted; others receive the third stop; the robot is free",
    also=("STP-11",),
)
async def reset_of_a_replaced_stop_resets_its_replacement(ctx: CaseContext) -> None:
    client, other = await ctx.operator(), await ctx.client("observer", "other")
    stops = [(await client.call("stop", "stopped", robot=ctx.robot))["stop"] for _ in range(3)]
    await ctx.wait_at_rest()
    answer = await ctx.reset_stop(client, stops[0])
    check((answer["stop"], answer.get("lifted")) == (stops[0], stops[2]), f"the answer is {answer}")
    received = await next_broadcast(other, "resumed")
    check(received["stop"] == stops[2], f"another session received {received}")
    await client.expect_refusal("reset", "unknown_stop", stop=stops[1])
    await client.call("acquire", "lease", robot=ctx.robot)


@case(
    "MSG-12/overtaken",
    "Stop a robot; send many pings, a reset of that stop and the same stop again in one write",
    "After all answers, the robot is still stopped by the second stop",
)
async def reset_overtaken_by_a_stop_has_no_effect(ctx: CaseContext) -> None:
    client = await ctx.operator()
    first = (await client.call("stop", "stopped", robot=ctx.robot))["stop"]
    await ctx.wait_at_rest()
    pings = [{"type": "ping", "time": 0.0} for _ in range(200)]
    last = {"type": "stop", "id": 501, "robot": ctx.robot}
    client.send(
        *pings, {"type": "reset", "id": 500, "stop": first}, last, {"type": "ping", "id": 502, "time": 0.0}
    )
    await client.answer_to(502)
    await client.expect_refusal("acquire", "stopped", robot=ctx.robot)


@case(
    "STP-18/replaced",
    "As an operator with the capability stop.replaces, stop a robot twice with one reason, and reset the first stop",
    "An error unknown_stop, and the second stop stays in force until it is reset",
    also=("STP-9",),
)
async def reset_of_a_replaced_stop_is_unknown_with_the_capability(ctx: CaseContext) -> None:
    if "stop.replaces" not in ctx.server.welcome.get("capabilities", ()):
        raise Skip("the server does not announce the capability stop.replaces")
    client = await ctx.client("operator", "operator", capabilities=["stop.replaces"])
    first, second = [(await client.call("stop", "stopped", robot=ctx.robot))["stop"] for _ in range(2)]
    await ctx.wait_at_rest()
    await client.expect_refusal("reset", "unknown_stop", stop=first)
    await client.expect_refusal("acquire", "stopped", robot=ctx.robot)
    await ctx.reset_stop(client, second)
    await client.call("acquire", "lease", robot=ctx.robot)
