"""Commands that are refused before the gate: the order of checks, and the slot they leave free."""

import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import admitted, cause, refused, together
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, Unmet, check

_TRIES = 20


@case(
    "CMD-8/nobody",
    "Command a robot that nobody holds, with the fence of the last lease",
    "Refused by lease",
    also=("CMD-17",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    await holder.wire.answered("release", "lease", robot=trial.robot, fence=holder.fence)
    for fence in (holder.fence, holder.fence + 1, 0):
        refused(await holder.decided(fence=fence, forbidden="nobody holds the robot"), "lease")


_FENCES = {"old": -1, "next": +1, "far": 10**12}

for _slug, _by in _FENCES.items():

    @case(
        f"CMD-9/{_slug}",
        f"Command with a fence {_by:+} off",
        "Refused by fence; the slot stays free",
        also=("CMD-17",),
    )
    async def _(trial: Trial, by: int = _by) -> None:
        holder = await trial.holder()
        bad, good = await together(
            holder,
            lambda tick: holder.forbid(
                holder.command(tick, fence=max(0, holder.fence + by)), "another fence"
            ),
            holder.command,
        )
        refused(bad, "fence")
        admitted(good)


@case(
    "CMD-9/stolen",
    "Another session commands with the holder's fence, while it moves and after",
    "Refused by fence: a number that was seen gives nobody a robot",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    thief = await trial.client(name="thief")
    for _ in range(5):
        tick = (await holder.fresh())["tick"]
        stolen = holder.forbid(holder.command(tick), "it is not the holder's")
        thief.say(stolen)
        refused(await thief.expect("verdict", seq=stolen["seq"]), "fence")
    await holder.moved()


@case(
    "CMD-10/stopped",
    "Stop the robot while it moves; its holder commands on",
    "Refused, by lease or stopped; it comes to rest",
    also=("STP-4", "CMD-35"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(5):
        await holder.moved()
    other = await trial.client("observer", "other")
    await other.answered("stop", "stopped", robot=trial.robot)
    for _ in range(5):
        verdict = await holder.decided(forbidden="the robot is stopped")
        check(
            verdict["outcome"] == "refused" and cause(verdict) in ("lease", "stopped"),
            f"it was {verdict['outcome']} by {cause(verdict)}",
        )
    await trial.rested()


@case(
    "CMD-11/link",
    "Command a robot whose link is not ready, if the cell has one",
    "Refused by link; the slot stays free",
    also=("CMD-7",),
)
async def _(trial: Trial) -> None:
    out = next(filter(trial.out_of_reach, (r["name"] for r in trial.facts.description["robots"])), None)
    if out is None:
        raise Skip("the links of all robots are ready")
    holder = await trial.holder(robot=out)
    command = holder.forbid(holder.command(0, [0.0] * holder.n), "its link is not ready")
    refused(await holder.verdict(command), "link")


for _slug, _ahead in {"next": 1, "far": 1000, "huge": 2**62}.items():

    @case(
        f"CMD-12/{_slug}",
        f"Command based on a tick {_ahead} ahead",
        "Refused by ahead; the slot stays free",
        also=("CMD-17",),
    )
    async def _(trial: Trial, ahead: int = _ahead) -> None:
        holder = await trial.holder()
        for _ in range(_TRIES):
            # By the time it is judged the next tick may have been: then it was not ahead.
            bad, good = await together(holder, lambda tick: holder.command(tick + ahead), holder.command)
            if ahead > 1 or cause(bad) == "ahead":
                refused(bad, "ahead")
                return admitted(good)
        raise Unmet(f"a command one tick ahead was never refused; the last time: {bad['outcome']}")


@case(
    "CMD-13/stale",
    "Command based on a tick one older than max_age_ticks allows, and on tick 0",
    "Refused by stale; the slot stays free",
    also=("CMD-17",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    age = trial.facts.max_age + 1
    if trial.observer.tick(trial.robot) <= age:
        await trial.observer.ticks(trial.robot, age)
    bad, good = await together(
        holder, lambda tick: holder.forbid(holder.command(tick - age), "its tick is too old"), holder.command
    )
    refused(bad, "stale")
    admitted(good)
    refused(await holder.verdict(holder.command(0)), "stale")


@case("CMD-13/just", "Command based on a tick just as old as max_age_ticks allows", "Not refused by stale")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    await trial.observer.until(lambda: trial.observer.tick(trial.robot) > trial.facts.max_age, "enough ticks")
    for _ in range(2 * _TRIES):
        tick = (await holder.fresh())["tick"]
        verdict = await holder.verdict(holder.command(tick - trial.facts.max_age))
        if cause(verdict) != "stale":
            return
    raise Unmet("it was refused by stale every time, though the newest tick had just come")


@case(
    "CMD-14/double",
    "Send two commands for one tick in one write",
    "The second is refused by occupied; the first is applied",
    also=("CMD-17", "CMD-18"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    first, second = await together(
        holder, holder.command, lambda tick: holder.command(tick, [0.0] * holder.n), good=0
    )
    for _ in range(_TRIES):
        if cause(second) is not None:
            break
        first, second = await together(
            holder, holder.command, lambda tick: holder.command(tick, [0.0] * holder.n), good=0
        )
    admitted(first)
    refused(second, "occupied")
    await holder.applied(first)


@case(
    "CMD-14/after-refusal-by-gate",
    "Send a command that the gate cuts to little, then another for the tick",
    "The slot is taken: the second is refused by occupied",
    also=("CMD-18",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    huge = [1e6 * x for x in holder.small()]
    for _ in range(_TRIES):
        first, second = await together(
            holder, lambda tick: holder.command(tick, huge), holder.command, good=0
        )
        check(first["target"] is not None, f"the first has no target: {first}")
        if cause(second) == "occupied":
            return
    raise Unmet(f"the second was never refused by occupied; the last time it was {second['outcome']}")


_LENGTHS: dict[str, int] = {"short": -1, "long": 1, "empty": -64, "64": 64}

for _slug, _by in _LENGTHS.items():

    @case(
        f"CMD-15/{_slug}",
        f"Command with a dq that is {_slug if _by < 64 else '64 long'}",
        "Refused by length; the slot stays free",
        also=("CMD-17",),
    )
    async def _(trial: Trial, by: int = _by) -> None:
        holder = await trial.holder()
        count = 64 if by == 64 else max(0, holder.n + by)
        if count == holder.n:
            raise Skip(f"the robot has {count} joints")
        bad, good = await together(
            holder,
            lambda tick: holder.forbid(holder.command(tick, [0.0] * count), "its dq has another length"),
            holder.command,
        )
        refused(bad, "length")
        admitted(good)


for _slug, _value in {"nan": math.nan, "infinity": math.inf, "minus-infinity": -math.inf}.items():

    @case(
        f"CMD-16/{_slug}",
        f"Command with {_value} in dq, at the first and at the last joint",
        "Refused by not_finite; the slot stays free; nothing moves",
        also=("CMD-17", "PAY-16"),
    )
    async def _(trial: Trial, value: float = _value) -> None:
        holder = await trial.holder()
        for j in (0, holder.n - 1):
            dq = [value if i == j else 0.0 for i in range(holder.n)]
            bad, good = await together(
                holder,
                lambda tick, dq=dq: holder.forbid(holder.command(tick, dq), "its dq is not finite"),
                lambda tick: holder.command(tick, [0.0] * holder.n),
            )
            refused(bad, "not_finite")
            check(good["outcome"] != "refused", f"the slot was not free: {good.get('reasons')}")


_PRECEDENCE: dict[str, tuple[str, str, dict[str, Any]]] = {
    "fence-ahead": ("fence", "another fence, a tick ahead", {"fence": 10**12, "tick": 2**40}),
    "fence-length": ("fence", "another fence and a wrong length", {"fence": 10**12, "dq": [0.0] * 60}),
    "ahead-length": ("ahead", "a tick ahead and a wrong length", {"tick": 2**40, "dq": [0.0] * 60}),
    "stale-length": ("stale", "tick 0 and a wrong length", {"tick": 0, "dq": [0.0] * 60}),
    "stale-nan": ("stale", "tick 0 and NaN", {"tick": 0, "dq": "nan"}),
    "length-nan": ("length", "a wrong length, of NaN", {"dq": [math.nan] * 60}),
}

for _slug, (_cause, _what, _more) in _PRECEDENCE.items():

    @case(
        f"CMD-7/{_slug}",
        f"Command with {_what}",
        f"Refused by {_cause}, the first in the order of the checks",
        also=("CMD-17",),
    )
    async def _(trial: Trial, expected: str = _cause, more: dict[str, Any] = _more) -> None:
        holder = await trial.holder()
        await trial.observer.until(
            lambda: trial.observer.tick(trial.robot) > trial.facts.max_age, "enough ticks"
        )
        fields = more | ({"dq": [math.nan] * holder.n} if more.get("dq") == "nan" else {})
        for _ in range(_TRIES):
            tick = (await holder.fresh())["tick"]
            verdict = await holder.verdict(holder.command(tick) | fields)
            if cause(verdict) == expected or cause(verdict) != "stale":
                break
        refused(verdict, expected)


@case(
    "CMD-7/occupied-length",
    "Send a good command and one of wrong length for one tick",
    "The second is refused by occupied",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(_TRIES):
        first, second = await together(
            holder, holder.command, lambda tick: holder.command(tick, [0.0] * 60), good=0
        )
        if cause(second) != "length":
            break
    admitted(first)
    refused(second, "occupied")
