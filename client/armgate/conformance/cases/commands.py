"""Commands and their verdicts: one each, in order, to the sender."""

import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import admitted, cause, entry, refused
from armgate.conformance.packing import pack
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Unmet, check

_SAME = 1e-9
_TRIES = 20


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
