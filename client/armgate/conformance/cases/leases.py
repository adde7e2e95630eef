"""Leases: one holder per robot, growing fences, and every way to lose a lease."""

import asyncio
from functools import partial
from typing import Any, Literal, assert_never

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import cause_of, check_refused

_ROUNDS = 12
_RELEASE, _NOT_HELD = "Release the robot", "An error not_held, without effect"

_ACCELERATION_TIME = 3.0
"""Time in which the kit tries to accelerate a robot, s."""


async def lease_lost(client: Connection, fence: int, within: float | None = None) -> Fields:
    """Return the message that a lease was lost, and check its fence."""
    lost = await client.receive(lambda m: m["type"] == "lease" and m["state"] == "lost", "lease lost", within)
    check(lost["fence"] == fence, f"the lost lease has fence {lost['fence']}; expected {fence}")
    return lost


@case(
    "LEA-1/free",
    "Acquire a free robot, as controller and as operator",
    "held, with a fence, the ttl and the requested speed",
    also=("LEA-18",),
)
async def free_robot_can_be_acquired(ctx: CaseContext) -> None:
    for role in ("controller", "operator"):
        client = await ctx.client(role, role)
        lease = await client.call("acquire", "lease", robot=ctx.robot, speed=0.5)
        found = (lease["state"], lease["robot"], lease.get("speed"), lease["ttl"])
        check(found == ("held", ctx.robot, 0.5, ctx.server.ttl), f"the lease has {found}")
        await client.call("release", "lease", robot=ctx.robot, fence=lease["fence"])


@case(
    "LEA-2/grows",
    "Acquire again, release and acquire, reconnect, take over",
    "Every fence is larger than all previous ones",
)
async def fences_only_grow(ctx: CaseContext) -> None:
    fences: list[int] = []
    for i in range(3):
        client = await ctx.client(name=f"c{i}")
        for _ in range(3):
            lease = await client.call("acquire", "lease", robot=ctx.robot)
            fences.append(lease["fence"])
        await client.call("release", "lease", robot=ctx.robot, fence=fences[-1])
        fences.append((await client.call("acquire", "lease", robot=ctx.robot))["fence"])
        operator = await ctx.client("operator", f"o{i}")
        fences.append((await operator.call("acquire", "lease", robot=ctx.robot, takeover=True))["fence"])
        operator.close()
        await ctx.wait_free()
    check(fences == sorted(set(fences)), f"the fences were {fences}")


@case(
    "LEA-3/held",
    "Acquire a robot that another session holds",
    "An error leased; the holder can still move the robot",
)
async def held_robot_cannot_be_acquired(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    other = await ctx.client(name="other")
    await other.expect_refusal("acquire", "leased", robot=ctx.robot)
    operator = await ctx.operator()
    await operator.expect_refusal("acquire", "leased", robot=ctx.robot)
    verdict = await holder.move()
    check(verdict["outcome"] == "admitted", f"the holder's command was {verdict['outcome']}")


@case(
    "LEA-4/race",
    f"Four sessions acquire one free robot at the same time, {_ROUNDS} times",
    "Exactly one session acquires it each time",
)
async def concurrent_acquires_have_one_winner(ctx: CaseContext) -> None:
    wires = [await ctx.client(name=f"c{i}") for i in range(4)]
    for _ in range(_ROUNDS):
        answers = await asyncio.gather(*(client.request("acquire", robot=ctx.robot) for client in wires))
        held = [i for i, answer in enumerate(answers) if answer["type"] == "lease"]
        check(len(held) == 1, f"{len(held)} sessions acquired the robot")
        others = {answer.get("code") for answer in answers if answer["type"] == "error"}
        check(others == {"leased"}, f"the others received {others}")
        fence = answers[held[0]]["fence"]
        await wires[held[0]].call("release", "lease", robot=ctx.robot, fence=fence)


@case(
    "LEA-5/again",
    "The holder acquires again, then commands with the old fence and the new",
    "Refused by fence, then admitted; no lease is lost",
    also=("CMD-9", "LEA-17"),
)
async def acquire_by_the_holder_replaces_its_fence(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    old = holder.fence
    holder.fence = (await holder.connection.call("acquire", "lease", robot=ctx.robot))["fence"]
    check_refused(await holder.command(fence=old, forbidden="its fence is old"), "fence")
    await holder.move()
    await holder.connection.sync()
    losses = [m for m in holder.connection.inbox if m["type"] == "lease"]
    check(not losses, f"a repeated acquire was reported as a loss: {losses}")


@case(
    "LEA-7/held",
    "As controller, take over a robot that another session holds",
    "An error forbidden; the holder can still move the robot",
)
async def controller_cannot_take_over(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    other = await ctx.client(name="other")
    await other.expect_refusal("acquire", "forbidden", robot=ctx.robot, takeover=True)
    await holder.move()


@case(
    "LEA-8/takeover",
    "An operator takes the robot over while it moves",
    "The holder receives lost with its own fence; its commands are refused by fence, and those of the operator are admitted",
    also=("LEA-17", "CMD-9", "CMD-35", "LEA-21"),
)
async def operator_takes_over_a_moving_robot(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(5):
        await holder.move()
    operator = await ctx.holder("operator", "operator", takeover=True)
    check(operator.fence > holder.fence, f"the fence went from {holder.fence} to {operator.fence}")
    await lease_lost(holder.connection, holder.fence)
    taken = "another session holds the robot"
    check_refused(await holder.command(forbidden=taken), "fence")
    check_refused(await holder.command(fence=operator.fence, forbidden=taken), "fence")
    await operator.move()


@case(
    "LEA-11/release",
    "Release a robot while it moves",
    "released; it comes to rest; another session can acquire it; commands are refused by lease",
    also=("CMD-8", "CMD-35", "LEA-21"),
)
async def released_robot_comes_to_rest_and_is_free(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(5):
        await holder.move()
    answer = await holder.connection.call("release", "lease", robot=ctx.robot, fence=holder.fence)
    check(answer["state"] == "released", f"the lease is {answer['state']}")
    check_refused(await holder.command(forbidden="the lease was released"), "lease")
    await ctx.wait_at_rest()
    other = await ctx.client(name="other")
    await other.call("acquire", "lease", robot=ctx.robot)


@case("LEA-12/other", f"{_RELEASE} by a session that does not hold it", _NOT_HELD, also=("ERR-2",))
async def release_by_another_session_is_refused(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    other = await ctx.client(name="other")
    await other.expect_refusal("release", "not_held", robot=ctx.robot, fence=holder.fence)
    await holder.move()


@case("LEA-12/fence", f"{_RELEASE} with another fence", _NOT_HELD, also=("ERR-2",))
async def release_with_another_fence_is_refused(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for fence in (holder.fence + 1, holder.fence - 1, 2**63 - 1):
        await holder.connection.expect_refusal("release", "not_held", robot=ctx.robot, fence=fence)
    await holder.move()


@case("LEA-12/twice", f"{_RELEASE} twice", _NOT_HELD, also=("ERR-2",))
async def second_release_is_refused(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    await holder.connection.call("release", "lease", robot=ctx.robot, fence=holder.fence)
    await holder.connection.expect_refusal("release", "not_held", robot=ctx.robot, fence=holder.fence)


@case(
    "LEA-13/silence",
    "Hold and move the robot, then send nothing",
    "Shortly after the ttl the lease is lost and the robot is at rest; commands are refused by lease; others can acquire it",
    also=("LEA-17", "LEA-21", "CMD-35", "CMD-8"),
)
async def lease_of_a_silent_holder_expires(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    for _ in range(5):
        await holder.move()
    await lease_lost(holder.connection, holder.fence, ctx.server.ttl + ctx.target.timeout)
    check_refused(await holder.command(forbidden="the lease has expired"), "lease")
    other = await ctx.client(name="other")
    await other.call("acquire", "lease", robot=ctx.robot)


_MESSAGES: dict[str, Fields] = {"ping": {"time": 1.0}, "describe": {}}


async def any_message_renews_the_lease(ctx: CaseContext, kind: str, fields: Fields) -> None:
    holder = await ctx.holder()
    loop = asyncio.get_running_loop()
    end = loop.time() + 2 * ctx.server.ttl
    period = ctx.server.robot["period"]
    while loop.time() < end:
        await holder.connection.request(kind, **fields)
        await ctx.observer.ticks(ctx.robot, max(1, int(ctx.server.ttl / 4 / period)))
    await holder.move()


for _slug, _fields in _MESSAGES.items():
    case(
        f"LEA-14/{_slug}",
        f"Hold the robot for twice the ttl of its lease, sending {_slug} every quarter of the ttl",
        "The lease stays in force, with the same fence",
    )(partial(any_message_renews_the_lease, kind=_slug, fields=_fields))


@case(
    "LEA-14/commands",
    "Hold the robot for 1.5 times the ttl of its lease by commands alone",
    "The lease stays in force",
)
async def commands_renew_the_lease(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    loop = asyncio.get_running_loop()
    end = loop.time() + 1.5 * ctx.server.ttl
    while loop.time() < end:
        verdict = await holder.command([0.0] * holder.n)
        check(
            cause_of(verdict) not in ("lease", "fence"), "the lease ended although its holder sends commands"
        )


Ending = Literal["close", "reset", "bye", "half-close"]

_ENDS: dict[Ending, str] = {
    "close": "closes its connection",
    "reset": "resets its connection",
    "bye": "sends bye",
    "half-close": "closes its sending side",
}


async def ended_connection_frees_its_robot_at_once(ctx: CaseContext, how: Ending) -> None:
    holder = await ctx.holder()
    for _ in range(5):
        await holder.move()
    tick = ctx.observer.tick(ctx.robot)
    match how:
        case "close":
            holder.connection.close()
        case "reset":
            holder.connection.reset()
        case "bye":
            holder.connection.send({"type": "bye"})
        case "half-close":
            can = holder.connection.can_half_close()
            (holder.connection.half_close if can else holder.connection.close)()
        case _:
            assert_never(how)
    await ctx.wait_free()
    held_for = (ctx.observer.tick(ctx.robot) - tick) * ctx.server.robot["period"]
    late = 0.8 * ctx.server.ttl + ctx.target.faults.delay
    check(held_for < late, f"the robot was still held for {held_for:.3f} s; the ttl is {ctx.server.ttl} s")


for _slug, _what in _ENDS.items():
    case(
        f"LEA-16/{_slug}",
        f"The holder of a moving robot {_what}",
        "The robot is free at once, long before the ttl, and comes to rest",
        also=("LOS-1", "LOS-2", "LEA-21", "CON-10"),
    )(partial(ended_connection_frees_its_robot_at_once, how=_slug))


@case(
    "LEA-17/once",
    "Lose a lease by takeover, then end the session that took it over",
    "The loss is reported once",
)
async def loss_of_a_lease_is_reported_once(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    operator = await ctx.operator()
    await operator.call("acquire", "lease", robot=ctx.robot, takeover=True)
    await lease_lost(holder.connection, holder.fence)
    operator.close()
    await ctx.wait_free()
    await holder.connection.sync()
    again = [m for m in holder.connection.inbox if m["type"] == "lease"]
    check(not again, f"lost is reported again: {again}")


@case(
    "LEA-19/two",
    "One session acquires two robots and moves both",
    "Both are held; each has its own fence and verdicts",
    also=("CMD-3",),
)
async def session_can_hold_two_robots(ctx: CaseContext) -> None:
    first = await ctx.holder()
    other = ctx.other_robot()
    second = await ctx.holder(name="second", robot=other)
    await first.connection.expect_refusal("acquire", "leased", robot=other)
    await second.connection.call("release", "lease", robot=other, fence=second.fence)
    lease = await first.connection.call("acquire", "lease", robot=other)
    entries: Any = ctx.observer.entries
    n = len(entries[other]["setpoint"])
    await first.move()
    command = {
        "robot": other,
        "fence": lease["fence"],
        "seq": next(first.connection.commands.seqs),
        "tick": ctx.observer.tick(other),
    }
    first.connection.send({"type": "command", **command, "dq": [0.0] * n})
    verdict = await first.connection.expect("verdict", robot=other, seq=command["seq"])
    check(
        cause_of(verdict) not in ("lease", "fence"),
        f"the second robot's command was refused by {cause_of(verdict)}",
    )


@case(
    "LEA-20/speed",
    "Hold the robot with speed 0.1 and command its full speed; then hold it with 1.0",
    "With the first lease the robot never exceeds a tenth of its speed; with the second it may",
)
async def lease_limits_the_speed(ctx: CaseContext) -> None:
    slow = await ctx.holder(speed=0.1)
    joints, period = ctx.server.robot["joints"], ctx.server.robot["period"]
    bound = [0.1 * joint["velocity"] * period for joint in joints]
    wanted = [x * 100 for x in slow.small_increment()]
    fastest = [0.0] * slow.n
    for _ in range(12):
        verdict = await slow.command(wanted)
        fastest = [max(a, abs(b)) for a, b in zip(fastest, verdict["dq"], strict=True)]
    over = [j for j in range(slow.n) if fastest[j] > bound[j] * (1 + 1e-9)]
    check(not over, f"joints {over} were admitted at {fastest}; the bound of the lease is {bound}")
    await slow.connection.call("release", "lease", robot=ctx.robot, fence=slow.fence)
    await ctx.wait_at_rest()
    fast = await ctx.holder(name="fast")
    check(fast.lease.get("speed", 1.0) == 1.0, f"the next lease has the speed {fast.lease.get('speed')}")
    loop = asyncio.get_running_loop()
    end = loop.time() + _ACCELERATION_TIME
    while loop.time() < end:
        verdict = await fast.command([-x for x in wanted])
        if any(abs(d) > b * (1 + 1e-9) for d, b in zip(verdict["dq"], bound, strict=True)):
            return
    raise Skip("this machine is too slow to command a robot tick by tick")


@case(
    "LEA-10/stopped",
    "Acquire a stopped robot, as controller and as operator with takeover",
    "An error stopped each time",
    also=("STP-12",),
)
async def stopped_robot_cannot_be_acquired(ctx: CaseContext) -> None:
    client = await ctx.client()
    await client.call("stop", "stopped", robot=ctx.robot)
    await client.expect_refusal("acquire", "stopped", robot=ctx.robot)
    operator = await ctx.operator()
    await operator.expect_refusal("acquire", "stopped", robot=ctx.robot, takeover=True)
