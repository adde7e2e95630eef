"""Commands and verdicts: order of checks, one verdict each, and what the robot does."""

import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import Holder, cause, entry, refused
from armgate.conformance.packing import Fields, pack
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, Unmet, check

_SAME = 1e-9
_TRIES = 20
_FAR = 3.0
"""How long the kit drives towards a limit, s of the robot's full speed."""


def admitted(verdict: Fields) -> None:
    """Check that a verdict lets a command through as it was asked."""
    check(
        verdict["outcome"] == "admitted",
        f"expected admitted, got {verdict['outcome']}: {verdict.get('reasons')}",
    )


async def together(holder: Holder, *makes: Any, good: int = -1) -> list[Fields]:
    """The verdicts of commands sent in one write, all based on one fresh tick that did not pass meanwhile.

    Args:
        holder: Sends them.
        makes: Make the commands of a tick.
        good: Which of them must not have come too late.

    Raises:
        Unmet: The tick always passed.
    """
    for _ in range(_TRIES):
        tick = (await holder.fresh())["tick"]
        commands = [make(tick) for make in makes]
        holder.wire.say(*commands)
        verdicts = [await holder.wire.expect("verdict", seq=command["seq"]) for command in commands]
        told = verdicts[good]
        if cause(told) == "occupied" and any(v["target"] is not None for v in verdicts if v is not told):
            return verdicts  # the slot went to one of these, not to an earlier command
        targets = {verdict["target"] for verdict in verdicts} - {None}
        if len(targets) < 2 and cause(told) not in ("stale", "occupied"):
            return verdicts
    raise Unmet(f"{_TRIES} times in a row a tick passed between commands sent in one write")


# --- one verdict each -------------------------------------------------------------------------------------


@case(
    "CMD-1/one", "Send 20 commands, one each tick, and a ping", "20 verdicts, one each, to the sender alone"
)
async def _(trial: Trial) -> None:
    other = await trial.client("operator", "other")
    holder = await trial.holder()
    for i in range(20):
        await holder.decided(holder.small(0.5) if i < 10 else [0.0] * holder.n)
    await holder.wire.in_step()
    extra = [m for m in holder.wire.inbox if m["type"] == "verdict"]
    check(not extra, f"verdicts beyond one each: {extra}")
    await other.in_step()
    check(not any(m["type"] == "verdict" for m in other.inbox), "another session was told a verdict")


@case("CMD-1/observer", "Send a command as observer", "One verdict, refused by lease", also=("CMD-8",))
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    command = {
        "robot": trial.robot,
        "fence": 1,
        "seq": next(wire.ledger.seqs),
        "tick": 0,
        "dq": [0.0] * trial.n,
    }
    wire.say({"type": "command", **command})
    refused(await wire.expect("verdict", seq=command["seq"]), "lease")


@case("CMD-2/echo", "Send commands that are let through and refused", "Verdicts repeat robot, seq and tick")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for more in ({}, {"fence": holder.fence + 7}, {"dq": [math.nan] * holder.n}):
        tick = (await holder.fresh())["tick"]
        command = holder.command(tick, **more)
        verdict = await holder.verdict(command)
        for key in ("robot", "seq", "tick"):
            check(verdict[key] == command[key], f"{key} is {verdict[key]}, sent was {command[key]}")


@case(
    "CMD-3/order",
    "Send 30 commands in one write, good, bad and doubled",
    "30 verdicts in that order",
    also=("CMD-1",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    tick = (await holder.fresh())["tick"]
    dqs = [None, [0.0], [math.inf] * holder.n]
    commands = [holder.command(tick + i % 3 * 1000, dqs[i % 3]) for i in range(30)]
    holder.wire.say(*commands)
    for command in commands:
        await holder.wire.expect("verdict", seq=command["seq"])


@case(
    "CMD-4/before-state",
    "Move ten ticks, watching states on the same connection",
    "Every verdict comes before the state that applies it",
    also=("STA-6", "CMD-24"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(10):
        verdict = await holder.moved(holder.small(0.3))
        state = await holder.applied(verdict)
        told = entry(state, trial.robot)
        if told["tick"] == verdict["target"]:
            off = max(abs(a - b) for a, b in zip(told["setpoint"], verdict["setpoint"], strict=True))
            check(off <= _SAME, f"the setpoint at the target is {off} off the verdict's")


@case(
    "CMD-5/unknown-robot",
    "Command a robot that the cell does not have",
    "An unknown_robot with its seq, no verdict",
    also=("ERR-7",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    tick = (await holder.fresh())["tick"]
    command = holder.command(tick, robot="kit-no-robot")
    holder.wire.say(command)
    await holder.wire.expect("error", code="unknown_robot", seq=command["seq"], fatal=False)
    await holder.moved()


_UNREADABLE: dict[str, tuple[str, dict[str, Any]]] = {
    "text": ("a text in dq", {"dq": ["0.1", 0.0, 0.0]}),
    "bool": ("a bool in dq", {"dq": [True, 0.0, 0.0]}),
    "nil": ("nil in dq", {"dq": [None, 0.0, 0.0]}),
    "map": ("a map for dq", {"dq": {"0": 0.1}}),
    "nested": ("arrays in dq", {"dq": [[0.1], [0.0], [0.0]]}),
    "missing": ("no dq", {"dq": None}),
    "too-many": ("65 numbers in dq", {"dq": [0.0] * 65}),
    "tick-text": ("a text for tick", {"tick": "5"}),
    "tick-real": ("a broken number for tick", {"tick": 5.5}),
    "tick-negative": ("a negative tick", {"tick": -1}),
    "fence-bool": ("a bool for fence", {"fence": True}),
    "fence-huge": ("2**64 - 1 for fence", {"fence": 2**64 - 1}),
    "robot-number": ("a number for robot", {"robot": 7}),
}  # fmt: skip

for _slug, (_what, _more) in _UNREADABLE.items():

    @case(
        f"CMD-6/{_slug}",
        f"Send a command with {_what}, and a good one behind it",
        "An invalid_message with its seq and no verdict; the good one has the slot",
        also=("ERR-4", "ERR-7", "PAY-14"),
    )
    async def _(trial: Trial, more: dict[str, Any] = _more) -> None:
        holder = await trial.holder()
        for _ in range(_TRIES):
            tick = (await holder.fresh())["tick"]
            bad, good = holder.command(tick) | more, holder.command(tick)
            holder.wire.write(pack(bad), f"unreadable: {bad}")
            holder.wire.say(good)
            error = await holder.wire.expect("error", code="invalid_message", fatal=False, about="command")
            check(
                error.get("seq") == bad["seq"],
                f"the error names seq {error.get('seq')}, sent was {bad['seq']}",
            )
            verdict = await holder.wire.expect("verdict", seq=good["seq"])
            if cause(verdict) != "stale":
                return admitted(verdict)
        raise Unmet("the good command always came too late")


@case("CMD-6/no-seq", "Send a command without seq", "An invalid_message without seq; the connection stays")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    bad = holder.command((await holder.fresh())["tick"])
    del bad["seq"]
    holder.wire.write(pack(bad), f"without seq: {bad}")
    error = await holder.wire.expect("error", code="invalid_message", fatal=False, about="command")
    check(error.get("seq") is None, f"the error names seq {error.get('seq')}")
    await holder.moved()


# --- the order of checks ----------------------------------------------------------------------------------


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


# --- what is let through ----------------------------------------------------------------------------------


@case(
    "CMD-18/target",
    "Send small commands, one each tick",
    "target is a tick after the one seen; the state at it shows the seq applied",
    also=("STA-6",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(5):
        verdict = await holder.moved(holder.small(0.2))
        check(verdict["target"] > verdict["tick"], f"target {verdict['target']} for tick {verdict['tick']}")
        state = await holder.applied(verdict)
        check(
            state["tick"] >= verdict["target"],
            f"applied at {state['tick']}, before its target {verdict['target']}",
        )


@case(
    "CMD-20/admitted", "Send a small increment", "admitted: dq as asked, beta 1, no reasons", also=("CMD-23",)
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for share in (0.0, 0.5, 1.0):
        wish = holder.small(share)
        verdict = await holder.decided(wish)
        admitted(verdict)
        off = max(abs(a - b) for a, b in zip(verdict["dq"], wish, strict=True))
        check(off <= _SAME, f"admitted, but dq is {off} off what was asked")
        check(
            verdict["beta"] == 1.0 and not verdict.get("reasons"),
            f"beta {verdict['beta']}, {verdict.get('reasons')}",
        )


_GREEDY: dict[str, tuple[str, float]] = {
    "step": ("ten times what a tick allows", 25.0),
    "huge": ("1e300", 1e300),
}

for _slug, (_what, _factor) in _GREEDY.items():

    @case(
        f"CMD-21/{_slug}",
        f"Ask for an increment of {_what}",
        "limited: a smaller dq, beta in (0, 1] or less, a reason with joint, value and bound; the robot keeps its bounds",
        also=("CMD-19", "CMD-25", "CMD-27"),
    )
    async def _(trial: Trial, factor: float = _factor) -> None:
        holder = await trial.holder()
        wish = [math.copysign(factor, x) if factor > 1e9 and x else factor * x for x in holder.small()]
        verdict = await holder.decided(wish)
        check(verdict["outcome"] == "limited", f"it was {verdict['outcome']}")
        check(
            verdict["dq"] != wish and verdict["beta"] > 0,
            f"limited to {verdict['dq']} with beta {verdict['beta']}",
        )
        check(bool(verdict.get("reasons")), "limited without a reason")
        for reason in verdict["reasons"]:
            if reason["cause"] in ("increment", "acceleration"):
                told = [reason.get(key) for key in ("joint", "value", "bound")]
                check(None not in told, f"{reason['cause']} names joint, value and bound {told}")


@case(
    "CMD-19/acceleration",
    "At rest, ask for the full speed at once",
    "limited by acceleration or increment; the robot accelerates within its bound",
    also=("CMD-21", "CMD-25"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    joints, period = trial.facts.robot["joints"], trial.facts.robot["period"]
    wish = [
        math.copysign(j["velocity"] * period, x) if x else 0.0
        for j, x in zip(joints, holder.small(), strict=True)
    ]
    verdict = await holder.decided(wish)
    allowed = [j["acceleration"] * period**2 for j in joints]
    over = [i for i, d in enumerate(verdict["dq"]) if abs(d) > allowed[i] * (1 + 1e-6)]
    check(
        not over, f"from rest joints {over} are let go by {verdict['dq']}; the acceleration allows {allowed}"
    )
    if any(abs(w) > a * (1 + 1e-6) for w, a in zip(wish, allowed, strict=True)):
        causes = [reason["cause"] for reason in verdict.get("reasons", ())]
        check("acceleration" in causes, f"it was {verdict['outcome']} by {causes}, not by acceleration")


_NUMBERS: dict[str, Any] = {
    "2**63": 2**63,
    "2**64-1": 2**64 - 1,
    "-2**63": -(2**63),
    "max-float": 1.7976931348623157e308,
    "denormal": 5e-324,
    "minus-zero": -0.0,
}

for _slug, _value in _NUMBERS.items():

    @case(
        f"PAY-13/dq-{_slug.replace('*', 'x')}",
        f"Command with {_slug} in dq",
        "It is judged as the number that it is; the robot keeps its bounds",
        also=("CMD-25",),
    )
    async def _(trial: Trial, value: Any = _value) -> None:
        holder = await trial.holder()
        dq = [value if x else 0.0 for x in holder.small()]
        verdict = await holder.decided(dq)
        expected = "admitted" if abs(float(value)) < 1e-9 else "limited"
        check(
            verdict["outcome"] in (expected, "refused" if expected == "limited" else expected),
            f"it was {verdict['outcome']}",
        )
        check(all(map(math.isfinite, verdict["dq"])), f"dq is {verdict['dq']}")


@case(
    "CMD-22/refused",
    "Make every kind of refusal before the gate",
    "Outcome refused, beta 0, a reason, dq what the robot does anyway",
    also=("CMD-17", "CMD-29"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    bad: list[Fields] = [{"fence": 10**12}, {"tick": 2**40}, {"dq": []}, {"dq": [math.nan] * holder.n}]
    for more in bad:
        tick = (await holder.fresh())["tick"]
        verdict = await holder.verdict(holder.command(tick) | more)
        check(
            verdict["outcome"] == "refused" and verdict["beta"] == 0.0,
            f"{verdict['outcome']} with beta {verdict['beta']}",
        )
        check(len(verdict.get("reasons", ())) == 1, f"reasons: {verdict.get('reasons')}")


@case(
    "CMD-23/setpoint",
    "From rest, send a small increment",
    "setpoint of the verdict is the setpoint before plus dq",
    also=("CMD-24",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    before = entry(await holder.fresh(), trial.robot)["setpoint"]
    verdict = await holder.moved()
    off = max(abs(b + d - s) for b, d, s in zip(before, verdict["dq"], verdict["setpoint"], strict=True))
    check(off <= _SAME, f"setpoint is {off} off the one before plus dq")
    await holder.applied(verdict)


@case(
    "CMD-28/rest",
    "Move the robot ten ticks, then command no more",
    "It brakes and rests; applied_seq stays",
    also=("STA-7",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(10):
        verdict = await holder.moved(holder.small(0.6))
    end = entry(await holder.applied(verdict), trial.robot).get("stop_end")
    await trial.rested()
    samples = trial.observer.samples(trial.robot)
    check(samples[-1].applied == verdict["seq"], f"applied_seq is {samples[-1].applied} at rest")
    if end is not None:
        off = max(abs(a - b) for a, b in zip(end, samples[-1].setpoint, strict=True))
        check(off < 1e-6, f"the robot rests {off} off the stop_end told")


@case(
    "CMD-29/refused",
    "Move the robot; then send only refused commands",
    "It brakes and rests as if nothing came",
    also=("CMD-28", "CMD-22"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(8):
        await holder.moved(holder.small(0.6))
    bad: list[Fields] = [
        {"fence": 10**12},
        {"dq": [math.inf] * holder.n},
        {"dq": [0.1] * 60},
        {"tick": 2**40},
    ]
    for _ in range(6):
        for more in bad:
            tick = (await holder.fresh())["tick"]
            verdict = await holder.verdict(holder.command(tick, [x * 50 for x in holder.small()]) | more)
            check(verdict["outcome"] == "refused", f"{more} was {verdict['outcome']}")
    await trial.rested()


@case("CMD-30/zeros", "At rest, send a command of zeros", "admitted")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    await trial.rested()
    admitted(await holder.decided([0.0] * holder.n))


for _slug, _make in {
    "same": lambda seq: [seq, seq],
    "falling": lambda seq: [seq + 5, seq + 4, seq + 3],
    "largest": lambda seq: [2**63 - 1, 0],
}.items():

    @case(f"CMD-31/{_slug}", f"Send commands whose seq is {_slug}", "Each has its verdict")
    async def _(trial: Trial, make: Any = _make) -> None:
        holder = await trial.holder()
        for seq in make(next(holder.wire.ledger.seqs) + 1):
            tick = (await holder.fresh())["tick"]
            # Without effect, so that no later case finds a strange seq applied.
            await holder.verdict(holder.command(tick, [], seq=seq))
        for _ in range(10):
            next(holder.wire.ledger.seqs)


@case("CMD-33/reserved", "Command with a deadline long past and a horizon of 0", "Judged as without them")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    admitted(await holder.decided(deadline=-1e9, horizon=0))
    admitted(await holder.decided(deadline=None, horizon=None))


# --- bounds -----------------------------------------------------------------------------------------------


async def drive(trial: Trial, joint: int, sign: float) -> set[str]:
    """Drive one joint at full speed until it stops; all causes that were named.

    Raises:
        Skip: That takes too long.
    """
    holder = await trial.holder()
    bounds, period = trial.facts.robot["joints"][joint], trial.facts.robot["period"]
    wish = [sign * bounds["velocity"] * period if i == joint else 0.0 for i in range(holder.n)]
    named: set[str] = set()
    still = 0
    for _ in range(int(_FAR / period)):
        verdict = await holder.decided(wish)
        for reason in verdict.get("reasons", ()):
            named.add(reason["cause"])
            pair = reason["cause"] != "clearance" or reason.get("pair")
            check(bool(pair), f"clearance without the pair of bodies: {reason}")
        still = still + 1 if not any(verdict["dq"]) else 0
        if still > 3:
            return named
    raise Skip(f"joint {bounds['name']} is not bound within {_FAR:g} s of full speed")


@case(
    "CMD-26/limit",
    "Drive the joint that is nearest to one of its limits into it, at full speed",
    "It stops at or before the limit; joint_limit or clearance is named",
    also=("CMD-19", "CMD-22"),
)
async def _(trial: Trial) -> None:
    joints = trial.facts.robot["joints"]
    entry_: Any = trial.entry()
    rooms = [(side * (j["upper" if side > 0 else "lower"] - q) / j["velocity"], i, side) for i, (j, q) in enumerate(zip(joints, entry_["setpoint"], strict=True)) for side in (1.0, -1.0)]  # fmt: skip
    _, joint, side = min(rooms)
    named = await drive(trial, joint, side)
    check(bool(named & {"joint_limit", "clearance"}), f"it stopped; named were {sorted(named)}")


@case(
    "CMD-36/clearance",
    "Drive the first joint at full speed, up to 3 s, towards what is near",
    "If clearance binds, the robot stops before it and the verdict names the pair",
    also=("CMD-19", "CMD-27"),
)
async def _(trial: Trial) -> None:
    for sign in (1.0, -1.0):
        try:
            named = await drive(trial, 0, sign)
        except Skip:
            named = set()
        for wire in trial.wires:
            wire.close()
        await trial.freed()
        if "clearance" in named:
            return
    raise Skip("nothing is in the way of the first joint")


@case(
    "CMD-35/former",
    "Lose the lease in five ways; command with its fence each time",
    "Refused each time; the robot does not move",
    also=("CMD-8", "CMD-9"),
)
async def _(trial: Trial) -> None:
    wire = await trial.operator()
    for way in ("release", "again", "takeover", "stop"):
        holder = await trial.holder(name=way)
        match way:
            case "release":
                await holder.wire.answered("release", "lease", robot=trial.robot, fence=holder.fence)
            case "again":
                await holder.wire.answered("acquire", "lease", robot=trial.robot)
            case "takeover":
                await wire.answered("acquire", "lease", robot=trial.robot, takeover=True)
            case _:
                await wire.answered("stop", "stopped", robot=trial.robot)
        for _ in range(3):
            verdict = await holder.decided(forbidden=f"the lease ended by {way}")
            check(
                verdict["outcome"] == "refused",
                f"after {way} a command with the old fence was {verdict['outcome']}",
            )
        if way == "again":
            holder.wire.close()
            await trial.freed()
        if way == "takeover":
            wire.close()
            await trial.freed()
            wire = await trial.operator()


@case(
    "STA-16/clock",
    "Command, stop commanding, send garbage: count ticks over half a second",
    "The robot's clock goes on with its period",
)
async def _(trial: Trial) -> None:
    period = trial.facts.robot["period"]
    wire = await trial.client()
    begin = await wire.answered("ping", "pong", time=0.0)
    first = trial.observer.tick(trial.robot)
    holder = await trial.holder()
    for _ in range(10):
        await holder.moved(holder.small(0.2))
        odd = await trial.open("odd")
        odd.write(b"\x00\x00\x00\x01\xc1", "garbage")
    await trial.observer.ticks(trial.robot, max(10, int(0.5 / period)))
    end = await wire.answered("ping", "pong", time=0.0)
    ticks, seconds = trial.observer.tick(trial.robot) - first, end["received"] - begin["received"]
    # States and pongs travel for themselves; what is counted is the long run.
    check(
        abs(ticks * period - seconds) < 0.25 + 0.1 * seconds + trial.target.faults.delay,
        f"{ticks} ticks of {period} s in {seconds:.3f} s",
    )
