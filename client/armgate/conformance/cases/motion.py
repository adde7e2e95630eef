"""What is let through: increments, bounds, rest."""

import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import admitted, entry
from armgate.conformance.packing import Fields
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check

_SAME = 1e-9
_MOST_REASONS = 64
_FAR = 3.0
"""How long the kit drives towards a limit, s of the robot's full speed."""


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
    "CMD-38/joints",
    "Ask every joint for 1e308, and once more for -1e308",
    "Each joint is named in a reason; if the reasons are more than 64, 64 are told and the others counted",
    also=("CMD-19",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    names = {joint["name"] for joint in trial.facts.robot["joints"]}
    for wish in (1e308, -1e308):
        reasons = (await holder.decided([wish] * holder.n)).get("reasons") or []
        if len(reasons) < _MOST_REASONS:
            missing = names - {reason.get("joint") for reason in reasons}
            check(not missing, f"no reason names {sorted(missing)}, which cannot move so fast")
        else:
            check(len(reasons) == _MOST_REASONS, f"a verdict has {len(reasons)} reasons")
            text = reasons[-1]["text"]
            check(any(map(str.isdigit, text)), f"the last reason does not count what was left out: {text}")


@case(
    "CMD-19/acceleration",
    "At rest, ask for the full speed at once",
    "limited by acceleration or increment; the robot accelerates within its bound",
    also=("CMD-21", "CMD-25", "CMD-37"),
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


@case(
    "CMD-37/turn",
    "Ask for full speed for eight ticks, then for eight ticks the other way",
    "The robot accelerates, brakes and turns within the bounds of the joint",
    also=("CMD-19",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    joints, period = trial.facts.robot["joints"], trial.facts.robot["period"]
    full = [
        math.copysign(j["velocity"] * period, x) if x else 0.0
        for j, x in zip(joints, holder.small(), strict=True)
    ]
    for way in (1.0, -1.0):
        outcomes = [(await holder.decided([way * x for x in full]))["outcome"] for _ in range(8)]
        check(set(outcomes) != {"refused"}, "none of it was let through, though the joint has room")


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
