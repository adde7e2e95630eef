"""Stops, resets and signals."""

import math
import re
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import entry, later
from armgate.conformance.packing import Fields
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check
from armgate.conformance.wire import Wire


async def told(wire: Wire, kind: str) -> Fields:
    """The next message of a kind that is told to all."""
    return await wire.hear(lambda m: m["type"] == kind, kind)


for _role in ("observer", "controller", "operator"):

    @case(
        f"STP-1/{_role}",
        f"As {_role}, stop the cell while the robot moves",
        "stopped, with all robots; the robot brakes to rest and stays there",
        also=("STP-4", "STP-2", "MSG-9"),
    )
    async def _(trial: Trial, role: str = _role) -> None:
        holder = await trial.holder()
        for _ in range(8):
            await holder.moved(holder.small(0.8))
        wire = await trial.client(role, "stopper")
        answer = await wire.answered("stop", "stopped", reason="a case of the kit")
        names = [robot["name"] for robot in trial.facts.description["robots"]]
        check(sorted(answer["robots"]) == sorted(names), f"the stop is of {answer['robots']}")
        check((answer["by"], answer["reason"]) == (trial.name("stopper"), "a case of the kit"), f"{answer}")
        await trial.rested()
        await trial.observer.ticks(trial.robot, 5)


@case(
    "STP-2/everybody",
    "Stop the robot; look what three others are told",
    "Each is told stopped once, the asker as an answer",
    also=("MSG-5",),
)
async def _(trial: Trial) -> None:
    others = [await trial.client(role, role) for role in ("observer", "controller", "operator")]
    asker = await trial.client(name="asker")
    answer = await asker.answered("stop", "stopped", robot=trial.robot, reason="told")
    for wire in others:
        heard = await told(wire, "stopped")
        same = {key: heard[key] for key in ("stop", "robots", "reason", "by")}
        check(same == {key: answer[key] for key in same}, f"one was told {heard}, the asker {answer}")
        check(heard.get("re") is None, f"one that did not ask was told re {heard.get('re')}")
    for wire in (*others, asker):
        await wire.in_step()
        check(not any(m["type"] == "stopped" for m in wire.inbox), "stopped was told twice")


@case("STP-3/ids", "Stop five times", "Each stop has a larger id than the one before", also=("STP-7",))
async def _(trial: Trial) -> None:
    wire = await trial.client()
    ids = [(await wire.answered("stop", "stopped", robot=trial.robot))["stop"] for _ in range(5)]
    check(ids == sorted(set(ids)), f"the ids were {ids}")


@case(
    "STP-5/lease",
    "Stop a robot that is held",
    "Its holder is told stopped first, then lease lost",
    also=("LEA-17",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    other = await trial.client(name="other")
    await other.answered("stop", "stopped", robot=trial.robot)
    heard = [m for m in await holder.wire.heard() if m["type"] in ("stopped", "lease")]
    kinds = [m["type"] for m in heard]
    check(kinds == ["stopped", "lease"], f"the holder was told {kinds}")
    lost = heard[1]
    check((lost["state"], lost["fence"]) == ("lost", holder.fence), f"the lease is {lost}")


@case(
    "LEA-23/named",
    "Stop a robot that is held; command it and acquire it",
    "Verdict and error name the id of the stop in their texts",
    also=("CMD-8", "LEA-10"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    other = await trial.client(name="other")
    for number in range(12):  # an id of two digits is not found by chance
        stop = (await other.answered("stop", "stopped", robot=trial.robot, reason=f"{number}"))["stop"]
    verdict = await holder.decided(forbidden="the robot is stopped")
    text = " ".join(reason["text"] for reason in verdict["reasons"])
    check(str(stop) in re.findall(r"\d+", text), f"the verdict does not name stop {stop}: {text}")
    error = await other.ask("acquire", robot=trial.robot)
    check(error.get("code") == "stopped", f"acquire was answered by {error}")
    check(str(stop) in re.findall(r"\d+", error["text"]), f"stop {stop} is not named: {error['text']}")


@case(
    "STP-6/others",
    "Hold and move another robot while this one is stopped",
    "Its lease stays, its commands are admitted",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder(robot=trial.other_robot())
    await holder.moved()
    wire = await trial.client(name="stopper")
    answer = await wire.answered("stop", "stopped", robot=trial.robot)
    check(answer["robots"] == [trial.robot], f"the stop is of {answer['robots']}")
    await holder.moved()
    await holder.moved()


for _slug, _stop in {"never": 2**62, "lifted": None}.items():

    @case(
        f"STP-9/{_slug}",
        "Reset a stop that is not in force" + (": it was lifted before" if _stop is None else ""),
        "unknown_stop, not fatal",
        also=("ERR-2",),
    )
    async def _(trial: Trial, stop: int | None = _stop) -> None:
        wire = await trial.operator()
        if stop is None:
            stop = (await wire.answered("stop", "stopped", robot=trial.robot))["stop"]
            await trial.rested()
            await trial.lifted(wire, stop)
        await wire.refused("reset", "unknown_stop", stop=stop)


@case(
    "STP-10/moving",
    "Speed up, stop, and reset at once",
    "moving; the stop stays in force; reset when it rests is resumed",
    also=("STP-4",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder("operator")
    joints, period = trial.facts.robot["joints"], trial.facts.robot["period"]
    wish = [
        math.copysign(j["velocity"] * period, x) if x else 0.0
        for j, x in zip(joints, holder.small(), strict=True)
    ]
    for _ in range(12):
        await holder.decided(wish)
    stop = (await holder.wire.answered("stop", "stopped", robot=trial.robot))["stop"]
    answer = await holder.wire.ask("reset", stop=stop)
    if answer["type"] == "resumed":
        raise Skip("the robot was at rest before the reset came")
    check(
        (answer["type"], answer.get("code"), answer.get("fatal")) == ("error", "moving", False),
        f"got {answer}",
    )
    await trial.observer.until(lambda: stop in trial.observer.stops(), "the stop to be seen")
    await trial.rested()
    await trial.lifted(holder.wire, stop)


@case(
    "STP-11/told",
    "Stop and reset; look what another session is told",
    "resumed with the id and who reset it, without re",
    also=("MSG-5",),
)
async def _(trial: Trial) -> None:
    other = await trial.client("observer", "other")
    wire = await trial.operator()
    stop = (await wire.answered("stop", "stopped", robot=trial.robot))["stop"]
    await trial.rested()
    answer = await trial.lifted(wire, stop)
    heard = await told(other, "resumed")
    for one in (answer, heard):
        check((one["stop"], one["by"]) == (stop, trial.name("operator")), f"told was {one}")
    check(heard.get("re") is None, "the other session was told re")


@case(
    "STP-12/two",
    "Stop the cell and the robot; lift one of the stops",
    "The robot stays stopped until the other is lifted",
    also=("LEA-10",),
)
async def _(trial: Trial) -> None:
    wire = await trial.operator()
    first = (await wire.answered("stop", "stopped"))["stop"]
    second = (await wire.answered("stop", "stopped", robot=trial.robot))["stop"]
    await trial.rested()
    await trial.lifted(wire, first)
    await wire.refused("acquire", "stopped", robot=trial.robot)
    await trial.lifted(wire, second)
    await wire.answered("acquire", "lease", robot=trial.robot)


@case(
    "STP-13/anew",
    "Stop a robot that is held and moves, reset, command with the old fence, acquire anew, move",
    "The old fence is of no use; the setpoint is the measured position; then it moves",
    also=("CMD-35",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    for _ in range(6):
        await holder.moved(holder.small(0.5))
    operator = await trial.operator()
    stop = (await operator.answered("stop", "stopped", robot=trial.robot))["stop"]
    await trial.rested()
    await trial.lifted(operator, stop)
    verdict = await holder.decided(forbidden="its lease ended by the stop")
    check(verdict["outcome"] == "refused", f"a command with the old fence was {verdict['outcome']}")
    shown = entry(await later(holder.wire, trial.robot), trial.robot)
    check(shown["holder"] is None, f"after the reset {shown['holder']} holds the robot")
    off = max(abs(a - b) for a, b in zip(shown["q"], shown["setpoint"], strict=True))
    check(off < 1e-6, f"the setpoint is {off} off the measured position")
    again = await trial.holder(name="again")
    await again.moved()


@case(
    "STP-15/again",
    "Stop a robot twice for one reason, and once for another",
    "The second stop replaces the first, the third none; states list the second and the third",
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    told_ = [await wire.answered("stop", "stopped", robot=trial.robot, reason=reason) for reason in "aab"]
    first, second, third = (one["stop"] for one in told_)
    replaced = [one.get("replaces") for one in told_]
    check(replaced == [None, first, None], f"the stops {first}, {second}, {third} replace {replaced}")
    await trial.observer.until(lambda: third in trial.observer.stops(), "the stops to be seen")
    seen = sorted(trial.entry()["stops"])  # type: ignore[call-overload]
    check(seen == [second, third], f"in force are {seen}")


@case(
    "STP-16/many",
    "Stop a robot and the cell a hundred times each, every time for another reason, then reset them all",
    "Each stop is told; states list at most 64; when all are lifted, the robot is free",
    also=("CON-9",),
)
async def _(trial: Trial) -> None:
    wire = await trial.operator()
    for number in range(100):
        await wire.answered("stop", "stopped", robot=trial.robot, reason=f"{number}")
        last = await wire.answered("stop", "stopped", reason=f"{number}")
    await trial.observer.until(lambda: last["stop"] in trial.observer.stops(), "the stops to be seen")
    seen = sorted(trial.entry()["stops"])  # type: ignore[call-overload]
    check(len(seen) <= 64, f"{len(seen)} stops are in force")
    await trial.rested()
    for stop in seen:
        await trial.lifted(wire, stop)
    await wire.answered("acquire", "lease", robot=trial.robot)


@case(
    "STP-17/replaced",
    "Stop a robot three times for one reason, and reset the first of the stops",
    "resumed, with the third stop as lifted; others are told that the third was lifted; the robot is free",
    also=("STP-11",),
)
async def _(trial: Trial) -> None:
    wire, other = await trial.operator(), await trial.client("observer", "other")
    stops = [(await wire.answered("stop", "stopped", robot=trial.robot))["stop"] for _ in range(3)]
    await trial.rested()
    answer = await trial.lifted(wire, stops[0])
    check((answer["stop"], answer.get("lifted")) == (stops[0], stops[2]), f"the answer is {answer}")
    heard = await told(other, "resumed")
    check(heard["stop"] == stops[2], f"another session was told {heard}")
    await wire.refused("reset", "unknown_stop", stop=stops[1])
    await wire.answered("acquire", "lease", robot=trial.robot)


@case(
    "MSG-12/overtaken",
    "Stop a robot; send many pings, a reset of that stop and the same stop again in one write",
    "The robot is still stopped when all are answered, by the second stop",
)
async def _(trial: Trial) -> None:
    wire = await trial.operator()
    first = (await wire.answered("stop", "stopped", robot=trial.robot))["stop"]
    await trial.rested()
    pings = [{"type": "ping", "time": 0.0} for _ in range(200)]
    last = {"type": "stop", "id": 501, "robot": trial.robot}
    wire.say(
        *pings, {"type": "reset", "id": 500, "stop": first}, last, {"type": "ping", "id": 502, "time": 0.0}
    )
    await wire.answer_to(502)
    await wire.refused("acquire", "stopped", robot=trial.robot)


@case(
    "STP-18/replaced",
    "As an operator with the capability stop.replaces, stop a robot twice for one reason, and reset the first stop",
    "unknown_stop, and the second stop stays in force until it is reset",
    also=("STP-9",),
)
async def _(trial: Trial) -> None:
    if "stop.replaces" not in trial.facts.welcome.get("capabilities", ()):
        raise Skip("the server does not name the capability stop.replaces")
    wire = await trial.client("operator", "operator", capabilities=["stop.replaces"])
    first, second = [(await wire.answered("stop", "stopped", robot=trial.robot))["stop"] for _ in range(2)]
    await trial.rested()
    await wire.refused("reset", "unknown_stop", stop=first)
    await wire.refused("acquire", "stopped", robot=trial.robot)
    await trial.lifted(wire, second)
    await wire.answered("acquire", "lease", robot=trial.robot)


# --- signals ----------------------------------------------------------------------------------------------

_SIGNALS = 64
"""Signals that a state can hold."""


async def shown(trial: Trial, name: str) -> Fields | None:
    """A signal as the next states of a new observer show it."""
    wire = await trial.client("observer", f"eye-{len(trial.wires)}")
    await wire.answered("subscribe", "subscribed", robots=[trial.robot], fields=[])
    state = await later(wire, trial.robot)
    wire.close()
    signals: dict[str, Fields] = state.get("signals") or {}
    return signals.get(name)


@case(
    "SIG-1/shared",
    "Set a signal twice, of one number and of sixteen",
    "signaled; states show owner, newest value and time",
    also=("STA-14", "STA-15"),
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    name = trial.name("zoom")
    for value in ([1.5], [float(i) for i in range(16)]):
        answer = await wire.answered("signal", "signaled", name=name, value=value)
        check(answer["name"] == name, f"signaled {answer['name']}")
        seen = await shown(trial, name)
        check(seen is not None, "states do not show the signal")
        assert seen is not None
        check((seen["owner"], seen["value"]) == (trial.name("client"), value), f"states show {seen}")


@case(
    "SIG-3/owned",
    "Another session sets the same signal, also after the owner has set it again",
    "signal_owned; the value stays",
    also=("ERR-2",),
)
async def _(trial: Trial) -> None:
    owner, other = await trial.client(name="owner"), await trial.client(name="other")
    name = trial.name("zoom")
    await owner.answered("signal", "signaled", name=name, value=[1.0])
    await other.refused("signal", "signal_owned", name=name, value=[2.0])
    await owner.answered("signal", "signaled", name=name, value=[3.0])
    seen = await shown(trial, name)
    check(seen is not None and seen["value"] == [3.0], f"states show {seen}")


@case(
    "SIG-4/gone",
    "Set a signal, close; another session sets it",
    "It is gone from the states; the other one owns it then",
)
async def _(trial: Trial) -> None:
    owner, other = await trial.client(name="owner"), await trial.client(name="other")
    name = trial.name("zoom")
    await owner.answered("signal", "signaled", name=name, value=[1.0])
    owner.say({"type": "bye"})
    await owner.ends()
    check(await shown(trial, name) is None, "the signal of a session that ended is still shown")
    await other.answered("signal", "signaled", name=name, value=[2.0])


for _slug, _value in {
    "empty": [],
    "seventeen": [0.0] * 17,
    "nan": [math.nan],
    "text": ["1"],
    "scalar": 1.0,
}.items():

    @case(
        f"SIG-5/{_slug}",
        f"Set a signal to {_value}",
        "An invalid_message, not fatal; no signal",
        also=("ERR-4",),
    )
    async def _(trial: Trial, value: Any = _value) -> None:
        wire = await trial.client()
        name = trial.name("odd")
        await wire.refused("signal", "invalid_message", name=name, value=value)
        check(await shown(trial, name) is None, "the signal is shown")


@case(
    "SIG-6/full",
    "Set one signal more than there may be",
    "too_many_signals, not fatal; those before stay, and may be set on",
)
async def _(trial: Trial) -> None:
    limit = trial.facts.welcome["limits"]["signals"]
    wire = await trial.client()
    for i in range(limit):
        answer = await wire.ask("signal", name=trial.name(f"s{i}"), value=[float(i)])
        if answer.get("code") == "signal_rate":
            raise Skip("signals may come too slowly to fill the table")
        check(answer["type"] == "signaled", f"signal {i} of {limit}: {answer}")
    await wire.refused("signal", "too_many_signals", name=trial.name("more"), value=[0.0])
    await wire.answered("signal", "signaled", name=trial.name("s0"), value=[9.0])


@case(
    "SIG-9/operator",
    "As controller, set a signal whose name begins with operator.",
    "forbidden, not fatal; no signal",
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    name = f"operator.{trial.name('reserved')}"
    await wire.refused("signal", "forbidden", name=name, value=[1.0])
    check(await shown(trial, name) is None, "the signal is shown")


@case(
    "SIG-11/all",
    f"From two sessions, set more signals than {_SIGNALS} together",
    f"Not more than {_SIGNALS} are taken over; too_many_signals then, not fatal",
)
async def _(trial: Trial) -> None:
    taken = 0
    for who in ("one", "other"):
        wire = await trial.client("controller", who)
        for i in range(_SIGNALS + 1):
            answer = await wire.ask("signal", name=trial.name(f"{who}{i}"), value=[float(i)])
            if answer.get("code") == "signal_rate":
                raise Skip("signals may come too slowly to fill the table")
            if answer.get("code") == "too_many_signals":
                break
            taken += 1
    check(answer.get("code") == "too_many_signals", f"{taken} signals were taken over")
    check(taken <= _SIGNALS, f"{taken} signals were taken over")


@case(
    "SIG-7/rate",
    "Send signals three times as fast as allowed, for a second's worth and more",
    "Some are answered by signal_rate, not fatal; each has an answer; the connection stays",
)
async def _(trial: Trial) -> None:
    rate = trial.facts.welcome["limits"]["signal_rate"]
    if rate > 20_000:
        raise Skip(f"{rate:g} signals per second are more than the kit sends")
    wire = await trial.client()
    count = int(3 * rate) + 10
    wire.say(
        *(
            {"type": "signal", "id": 1000 + i, "name": trial.name("fast"), "value": [float(i)]}
            for i in range(count)
        )
    )
    answers = [await wire.answer_to(1000 + i) for i in range(count)]
    refusals = [a for a in answers if a["type"] == "error"]
    check(
        all(a["code"] == "signal_rate" and not a["fatal"] for a in refusals), f"another error: {refusals[:1]}"
    )
    check(answers[0]["type"] == "signaled", f"the first was answered by {answers[0]}")
    if not refusals:
        raise Skip("the server reads messages too slowly to see them come too fast")
    await wire.in_step()


@case("SIG-7/slow", "Send signals at a fifth of the rate", "All are taken over")
async def _(trial: Trial) -> None:
    rate = trial.facts.welcome["limits"]["signal_rate"]
    period = trial.facts.robot["period"]
    wire = await trial.client()
    for i in range(10):
        await wire.answered("signal", "signaled", name=trial.name("slow"), value=[float(i)])
        await trial.observer.ticks(trial.robot, max(1, round(5 / rate / period)))


@case(
    "SIG-8/verdict",
    "Have the same command judged before and after signals of every kind",
    "The verdicts are the same",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    found = []
    for names in ((), ("distance", "repulsion", "beta", trial.robot)):
        for name in names:
            await holder.wire.ask("signal", name=name, value=[0.0, 1e9])
        await trial.rested()
        verdict = await holder.decided([0.0] * holder.n)
        found.append((verdict["outcome"], verdict["beta"], verdict["dq"], verdict.get("reasons")))
    check(found[0] == found[1], f"before {found[0]}, after {found[1]}")
