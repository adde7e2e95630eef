"""Leases: one holder, fences that only grow, every way to lose one."""

import asyncio
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import cause, refused
from armgate.conformance.packing import Fields
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check
from armgate.conformance.wire import Wire

_ROUNDS = 12

_DRIVEN = 3.0
"""For how long the kit tries to get a robot to speed, s."""


async def lost(wire: Wire, fence: int, within: float | None = None) -> Fields:
    """The message that a lease was lost, with its own fence."""
    told = await wire.hear(lambda m: m["type"] == "lease" and m["state"] == "lost", "lease lost", within)
    check(told["fence"] == fence, f"the lease lost has fence {told['fence']}; it was {fence}")
    return told


@case(
    "LEA-1/free",
    "Acquire a free robot, as controller and as operator",
    "held, with a fence, the ttl and the speed asked for",
    also=("LEA-18",),
)
async def _(trial: Trial) -> None:
    for role in ("controller", "operator"):
        wire = await trial.client(role, role)
        lease = await wire.answered("acquire", "lease", robot=trial.robot, speed=0.5)
        told = (lease["state"], lease["robot"], lease.get("speed"), lease["ttl"])
        check(told == ("held", trial.robot, 0.5, trial.facts.ttl), f"the lease says {told}")
        await wire.answered("release", "lease", robot=trial.robot, fence=lease["fence"])


@case(
    "LEA-2/grows",
    "Acquire again, release and acquire, come again, take over",
    "Every fence is larger than all before",
)
async def _(trial: Trial) -> None:
    fences: list[int] = []
    for i in range(3):
        wire = await trial.client(name=f"c{i}")
        for _ in range(3):
            lease = await wire.answered("acquire", "lease", robot=trial.robot)
            fences.append(lease["fence"])
        await wire.answered("release", "lease", robot=trial.robot, fence=fences[-1])
        fences.append((await wire.answered("acquire", "lease", robot=trial.robot))["fence"])
        operator = await trial.client("operator", f"o{i}")
        fences.append(
            (await operator.answered("acquire", "lease", robot=trial.robot, takeover=True))["fence"]
        )
        operator.close()
        await trial.freed()
    check(fences == sorted(set(fences)), f"the fences were {fences}")


@case("LEA-3/held", "Acquire a robot that another session holds", "leased; the holder moves on unhindered")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    other = await trial.client(name="other")
    await other.refused("acquire", "leased", robot=trial.robot)
    operator = await trial.operator()
    await operator.refused("acquire", "leased", robot=trial.robot)
    verdict = await holder.moved()
    check(verdict["outcome"] == "admitted", f"the holder's command was {verdict['outcome']}")


@case(
    "LEA-4/race",
    f"Four sessions acquire one free robot at the same time, {_ROUNDS} times",
    "Exactly one gets it each time",
)
async def _(trial: Trial) -> None:
    wires = [await trial.client(name=f"c{i}") for i in range(4)]
    for _ in range(_ROUNDS):
        answers = await asyncio.gather(*(wire.ask("acquire", robot=trial.robot) for wire in wires))
        held = [i for i, answer in enumerate(answers) if answer["type"] == "lease"]
        check(len(held) == 1, f"{len(held)} sessions got the robot")
        others = {answer.get("code") for answer in answers if answer["type"] == "error"}
        check(others == {"leased"}, f"the others were told {others}")
        fence = answers[held[0]]["fence"]
        await wires[held[0]].answered("release", "lease", robot=trial.robot, fence=fence)


@case(
    "LEA-5/again",
    "The holder acquires again, then commands with the old fence and the new",
    "fence, then admitted; no lease lost",
    also=("CMD-9", "LEA-17"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    old = holder.fence
    holder.fence = (await holder.wire.answered("acquire", "lease", robot=trial.robot))["fence"]
    refused(await holder.decided(fence=old, forbidden="its fence is old"), "fence")
    await holder.moved()
    await holder.wire.in_step()
    told = [m for m in holder.wire.inbox if m["type"] == "lease"]
    check(not told, f"asking again was told as a loss: {told}")


@case(
    "LEA-7/held",
    "As controller, take over a robot that another session holds",
    "forbidden; the holder moves on",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    other = await trial.client(name="other")
    await other.refused("acquire", "forbidden", robot=trial.robot, takeover=True)
    await holder.moved()


@case(
    "LEA-8/takeover",
    "An operator takes the robot over while it moves",
    "The holder is told lost with its own fence; its commands are refused by fence, the operator's admitted",
    also=("LEA-17", "CMD-9", "CMD-35", "LEA-21"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(5):
        await holder.moved()
    operator = await trial.holder("operator", "operator", takeover=True)
    check(operator.fence > holder.fence, f"the fence went from {holder.fence} to {operator.fence}")
    await lost(holder.wire, holder.fence)
    taken = "another session holds the robot"
    refused(await holder.decided(forbidden=taken), "fence")
    refused(await holder.decided(fence=operator.fence, forbidden=taken), "fence")
    await operator.moved()


@case(
    "LEA-11/release",
    "Release a robot while it moves",
    "released; it comes to rest; another session gets it; commands are refused by lease",
    also=("CMD-8", "CMD-35", "LEA-21"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(5):
        await holder.moved()
    answer = await holder.wire.answered("release", "lease", robot=trial.robot, fence=holder.fence)
    check(answer["state"] == "released", f"the lease is {answer['state']}")
    refused(await holder.decided(forbidden="the lease was given back"), "lease")
    await trial.rested()
    other = await trial.client(name="other")
    await other.answered("acquire", "lease", robot=trial.robot)


for _slug, _what in {
    "other": "by a session that does not hold it",
    "fence": "with another fence",
    "twice": "twice",
}.items():

    @case(f"LEA-12/{_slug}", f"Release the robot {_what}", "not_held, without effect", also=("ERR-2",))
    async def _(trial: Trial, how: str = _slug) -> None:
        holder = await trial.holder()
        if how == "other":
            other = await trial.client(name="other")
            await other.refused("release", "not_held", robot=trial.robot, fence=holder.fence)
        elif how == "fence":
            for fence in (holder.fence + 1, holder.fence - 1, 2**63 - 1):
                await holder.wire.refused("release", "not_held", robot=trial.robot, fence=fence)
        else:
            await holder.wire.answered("release", "lease", robot=trial.robot, fence=holder.fence)
            await holder.wire.refused("release", "not_held", robot=trial.robot, fence=holder.fence)
            return
        await holder.moved()


@case(
    "LEA-13/silence",
    "Hold and move the robot, then say nothing",
    "Within the ttl and a little the lease is lost and the robot rests; commands are refused by lease; others get it",
    also=("LEA-17", "LEA-21", "CMD-35", "CMD-8"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(5):
        await holder.moved()
    await lost(holder.wire, holder.fence, trial.facts.ttl + trial.target.patience)
    refused(await holder.decided(forbidden="the lease has expired"), "lease")
    other = await trial.client(name="other")
    await other.answered("acquire", "lease", robot=trial.robot)


_SIGNS: dict[str, Fields] = {"ping": {"time": 1.0}, "describe": {}}

for _slug, _fields in _SIGNS.items():

    @case(
        f"LEA-14/{_slug}",
        f"Hold the robot for two times to live, sending {_slug} four times in each",
        "It stays held, with the same fence",
    )
    async def _(trial: Trial, kind: str = _slug, fields: Fields = _fields) -> None:
        holder = await trial.holder()
        loop = asyncio.get_running_loop()
        end = loop.time() + 2 * trial.facts.ttl
        period = trial.facts.robot["period"]
        while loop.time() < end:
            await holder.wire.ask(kind, **fields)
            await trial.observer.ticks(trial.robot, max(1, int(trial.facts.ttl / 4 / period)))
        await holder.moved()


@case("LEA-14/commands", "Hold the robot for one and a half times to live by commands alone", "It stays held")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    loop = asyncio.get_running_loop()
    end = loop.time() + 1.5 * trial.facts.ttl
    while loop.time() < end:
        verdict = await holder.decided([0.0] * holder.n)
        check(cause(verdict) not in ("lease", "fence"), "the lease ended though its holder commands")


_ENDS: dict[str, str] = {
    "close": "closes",
    "reset": "is reset",
    "bye": "says bye",
    "half-close": "closes its sending side",
}

for _slug, _what in _ENDS.items():

    @case(
        f"LEA-16/{_slug}",
        f"The holder of a moving robot {_what}",
        "The robot is free at once, long before the ttl, and comes to rest",
        also=("LOS-1", "LOS-2", "LEA-21", "CON-10"),
    )
    async def _(trial: Trial, how: str = _slug) -> None:
        holder = await trial.holder()
        for _ in range(5):
            await holder.moved()
        tick = trial.observer.tick(trial.robot)
        match how:
            case "close":
                holder.wire.close()
            case "reset":
                holder.wire.reset()
            case "bye":
                holder.wire.say({"type": "bye"})
            case _ if holder.wire.can_half_close():
                holder.wire.half_close()
            case _:
                holder.wire.close()
        await trial.freed()
        gone = (trial.observer.tick(trial.robot) - tick) * trial.facts.robot["period"]
        late = 0.8 * trial.facts.ttl + trial.target.faults.delay
        check(gone < late, f"the robot was held {gone:.3f} s longer; the ttl is {trial.facts.ttl} s")


@case("LEA-17/once", "Lose a lease by takeover, then end the session that took it", "lost is told once")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    operator = await trial.operator()
    await operator.answered("acquire", "lease", robot=trial.robot, takeover=True)
    await lost(holder.wire, holder.fence)
    operator.close()
    await trial.freed()
    await holder.wire.in_step()
    again = [m for m in holder.wire.inbox if m["type"] == "lease"]
    check(not again, f"lost is told again: {again}")


@case(
    "LEA-19/two",
    "One session acquires two robots and moves both",
    "Both are held; each has its own fence and verdicts",
    also=("CMD-3",),
)
async def _(trial: Trial) -> None:
    first = await trial.holder()
    other = trial.other_robot()
    second = await trial.holder(name="second", robot=other)
    await first.wire.refused("acquire", "leased", robot=other)
    await second.wire.answered("release", "lease", robot=other, fence=second.fence)
    lease = await first.wire.answered("acquire", "lease", robot=other)
    entries: Any = trial.observer.entries
    n = len(entries[other]["setpoint"])
    await first.moved()
    command = {
        "robot": other,
        "fence": lease["fence"],
        "seq": next(first.wire.ledger.seqs),
        "tick": trial.observer.tick(other),
    }
    first.wire.say({"type": "command", **command, "dq": [0.0] * n})
    verdict = await first.wire.expect("verdict", robot=other, seq=command["seq"])
    check(
        cause(verdict) not in ("lease", "fence"),
        f"the second robot's command was refused by {cause(verdict)}",
    )


@case(
    "LEA-20/speed",
    "Hold the robot with speed 0.1 and ask for its full speed; then hold it with 1.0",
    "The first is never faster than a tenth; the second may be",
)
async def _(trial: Trial) -> None:
    slow = await trial.holder(speed=0.1)
    joints, period = trial.facts.robot["joints"], trial.facts.robot["period"]
    bound = [0.1 * joint["velocity"] * period for joint in joints]
    wish = [x * 100 for x in slow.small()]
    fastest = [0.0] * slow.n
    for _ in range(12):
        verdict = await slow.decided(wish)
        fastest = [max(a, abs(b)) for a, b in zip(fastest, verdict["dq"], strict=True)]
    over = [j for j in range(slow.n) if fastest[j] > bound[j] * (1 + 1e-9)]
    check(not over, f"joints {over} were let go at {fastest}; the lease's bound is {bound}")
    await slow.wire.answered("release", "lease", robot=trial.robot, fence=slow.fence)
    await trial.rested()
    fast = await trial.holder(name="fast")
    check(fast.lease.get("speed", 1.0) == 1.0, f"the next lease has the speed {fast.lease.get('speed')}")
    loop = asyncio.get_running_loop()
    end = loop.time() + _DRIVEN
    while loop.time() < end:
        verdict = await fast.decided([-x for x in wish])
        if any(abs(d) > b * (1 + 1e-9) for d, b in zip(verdict["dq"], bound, strict=True)):
            return
    raise Skip("the kit is too slow here to command a robot tick by tick")


@case(
    "LEA-10/stopped",
    "Acquire a stopped robot, as controller and as operator with takeover",
    "stopped each time",
    also=("STP-12",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    await wire.answered("stop", "stopped", robot=trial.robot)
    await wire.refused("acquire", "stopped", robot=trial.robot)
    operator = await trial.operator()
    await operator.refused("acquire", "stopped", robot=trial.robot, takeover=True)
