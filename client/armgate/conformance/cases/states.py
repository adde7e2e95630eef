"""Subscriptions and states."""

import itertools
import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.holder import cause, entry, later
from armgate.conformance.packing import Fields, pack
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, Unmet, check
from armgate.conformance.wire import Wire

FIELDS = (
    "q", "setpoint", "applied_seq", "stop_end", "nearest", "least_clearance", "holder", "stops", "link", "verdict",
    "counts", "late_commands",
)  # fmt: skip
"""The fields of an entry in version 1, beside robot, tick and time."""

_ROUNDING = 1e-6
"""m"""

_PAUSE = 1.0
"""For how long a slow reader reads nothing, s."""


_PASSED, _OWN, _LONGEST_PAUSE = 400_000, 130_000, 8.0
"""Bytes of states that pass while a client does not read, bytes that its own system may keep, and s at most."""


async def states(wire: Wire, count: int) -> list[Fields]:
    """The next states."""
    return [await wire.hear(lambda m: m["type"] == "state", "a state") for _ in range(count)]


@case(
    "SUB-1/all",
    "Subscribe with every left out",
    "subscribed: every 1, all robots in order, the known fields",
    also=("SUB-2",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    told = await wire.answered("subscribe", "subscribed")
    names = [robot["name"] for robot in trial.facts.description["robots"]]
    check(told["every"] == 1 and told["robots"] == names, f"subscribed says {told}")
    missing = set(FIELDS) - set(told["fields"])
    check(not missing, f"these fields are not among all: {sorted(missing)}")


@case("SUB-1/some", "Subscribe to one robot and two fields", "subscribed repeats just these", also=("STA-4",))
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    told = await wire.answered(
        "subscribe", "subscribed", every=3, robots=[trial.robot], fields=["q", "holder"]
    )
    check(told["every"] == 3 and told["robots"] == [trial.robot], f"subscribed says {told}")
    check(set(told["fields"]) == {"q", "holder"}, f"fields are {told['fields']}")


@case(
    "SUB-3/at-once",
    "Subscribe to every 10000th tick",
    "The newest state of each robot comes right after subscribed",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    await wire.answered("subscribe", "subscribed", every=10000)
    await wire.in_step()
    told = await wire.answered("subscribe", "subscribed", every=10000)
    names = {robot["name"] for robot in trial.facts.description["robots"]}
    await wire.answered("ping", "pong", time=1.0)
    check(bool(told), "no subscribed")
    wire.say({"type": "subscribe", "every": 10000}, {"type": "ping", "id": 77, "time": 1.0})
    found: list[Fields] = []
    await wire.hear(lambda m: found.append(m) or m.get("re") == 77, "pong")  # type: ignore[func-returns-value]
    about = [m["robot"] for m in found if m["type"] == "state"]
    check(set(about) == names, f"states of {sorted(set(about))} came at once; the cell has {sorted(names)}")


for _every in (1, 3):

    @case(
        f"SUB-4/every-{_every}",
        f"Subscribe to every {_every}. tick of the robot; read 12 states",
        "Their ticks are those that it divides, none left out",
        also=("STA-2", "STA-3", "STA-1"),
    )
    async def _(trial: Trial, every: int = _every) -> None:
        wire = await trial.client("observer")
        await wire.answered("subscribe", "subscribed", every=every, robots=[trial.robot])
        found = (await states(wire, 13))[1:]
        ticks = [state["tick"] for state in found]
        expected = list(range(ticks[0], ticks[0] + 12 * every, every))
        check(ticks == expected and ticks[0] % every == 0, f"ticks {ticks}, expected {expected}")
        times = [state["time"] for state in found]
        check(times == sorted(times), f"times {times}")
        names = [robot["name"] for robot in trial.facts.description["robots"]]
        for state in found:
            check(
                [one["robot"] for one in state["entries"]] == names,
                "entries are not those of all robots, in order",
            )
            own = entry(state, trial.robot)
            check(
                (own["tick"], own["time"]) == (state["tick"], state["time"]),
                "the robot's entry is of another tick",
            )


@case(
    "SUB-5/replaced",
    "Subscribe to all, then with other fields, then with every 0",
    "Each replaces the one before; then no state comes",
    also=("SUB-4",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    await wire.answered("subscribe", "subscribed")
    await wire.answered("subscribe", "subscribed", fields=["q"], robots=[trial.robot])
    for state in await states(wire, 5):
        check(
            set(entry(state, trial.robot)) == {"robot", "tick", "time", "q"},
            f"an entry has {sorted(entry(state, trial.robot))}",
        )
    await wire.answered("subscribe", "subscribed", every=0)
    await trial.observer.ticks(trial.robot, 10)
    await wire.in_step()
    check(not wire.inbox, f"after every 0 came {[m['type'] for m in wire.inbox]}")


@case(
    "SUB-6/unknown-field",
    "Subscribe; then subscribe with an unknown field and with an unknown robot",
    "unknown_field and unknown_robot; the first subscription stays",
    also=("ERR-2",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    await wire.answered("subscribe", "subscribed", fields=["holder"])
    await wire.refused("subscribe", "unknown_field", fields=["q", "colour"])
    await wire.refused("subscribe", "unknown_robot", robots=[trial.robot, "kit-no-robot"])
    wire.inbox.clear()
    for state in await states(wire, 3):
        check(
            set(entry(state, trial.robot)) == {"robot", "tick", "time", "holder"},
            "the first subscription is gone",
        )


@case("SUB-7/none", "Connect, acquire, command, and subscribe to nothing", "No state comes")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    lease = await wire.answered("acquire", "lease", robot=trial.robot)
    command = {
        "robot": trial.robot,
        "fence": lease["fence"],
        "seq": next(wire.ledger.seqs),
        "tick": trial.observer.tick(trial.robot),
    }
    wire.say({"type": "command", **command, "dq": [0.0] * trial.n})
    await wire.expect("verdict")
    await trial.observer.ticks(trial.robot, 10)
    await wire.in_step()
    check(not any(m["type"] == "state" for m in wire.inbox), "a state came without a subscription")


@case("SUB-9/own", "Two sessions subscribe differently", "Each is sent what it asked for")
async def _(trial: Trial) -> None:
    one, two = await trial.client("observer", "one"), await trial.client("observer", "two")
    await one.answered("subscribe", "subscribed", fields=["q"])
    await two.answered("subscribe", "subscribed", every=2, fields=["holder", "stops"])
    for state in await states(one, 6):
        check(
            set(entry(state, trial.robot)) == {"robot", "tick", "time", "q"},
            "the first is sent the other's fields",
        )
    for state in (await states(two, 6))[1:]:
        check("q" not in entry(state, trial.robot), "the second is sent the other's fields")


@case(
    "SUB-8/slow",
    "Subscribe, let megabytes of answers wait unread, let 20 ticks pass, then read",
    "Answers are all there; of the states that waited the newest came, not all",
    also=("CON-11", "CON-12"),
)
async def _(trial: Trial) -> None:
    size = trial.facts.robot["urdf"]["size"]
    for megabytes in (0.6, 0.9, 1.4, 2.0, 2.8, 3.6, 4.4, 5.2, 6.0, 7.0):
        wire = await trial.client("observer", f"slow-{megabytes}")
        await wire.answered("subscribe", "subscribed", robots=[trial.robot], fields=["q"])
        wire.deaf(True)
        count = int(megabytes * 1e6 / size)
        asset = {"type": "asset", "hash": trial.facts.robot["urdf"]["hash"]}
        wire.say(*({**asset, "id": 1000 + i} for i in range(count)))
        await trial.observer.ticks(trial.robot, int(_PAUSE / trial.facts.robot["period"]))
        wire.deaf(False)
        found: list[Fields] = []
        try:
            wire.say({"type": "ping", "id": 999, "time": 0.0})
            await wire.hear(lambda m, found=found: found.append(m) or m.get("re") == 999, "pong", within=60.0)  # type: ignore[misc]
        except Unmet:
            if wire.ended:
                raise Skip("the server cut a slow reader off before states had to be left out") from None
            raise
        answers = [m["re"] for m in found if m["type"] == "chunk"]
        check(
            answers == [1000 + i for i in range(count)],
            f"{len(answers)} of {count} answers came, or out of order",
        )
        found += await states(wire, 3)  # the newest that waited comes after all answers
        ticks = [m["tick"] for m in found if m["type"] == "state"]
        if any(b - a > 10 for a, b in itertools.pairwise(ticks)):
            return
        wire.close()
    raise Skip("the kernel's buffers hold more than the kit sends: no state had to be left out")


@case(
    "CON-11/overflow",
    "Ask for answers without end and read none of them, while another session moves the robot",
    "The slow reader is cut off; the mover and the ticks notice nothing",
    also=("CON-12", "CON-9"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    wire = await trial.client("observer", "glutton")
    wire.small_buffer()
    wire.deaf(True)
    asset = {"type": "asset", "hash": trial.facts.robot["urdf"]["hash"]}
    count, size = 0, trial.facts.robot["urdf"]["size"]
    while not wire.ended and count * size < 256e6:
        wire.say_quietly(*[asset] * 100)
        count += 100
        verdict = await holder.decided([0.0] * holder.n)
        check(cause(verdict) != "lease", "the mover lost its lease")
    check(
        count * size < 256e6 or wire.ended,
        f"{count * size / 1e6:.0f} MB of answers wait and the session is still there",
    )
    await holder.moved()


@case(
    "STA-4/null",
    "Look at entries with all fields, and with none",
    "All that were subscribed are there, holder nil while nobody holds; with none only robot, tick, time",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    told = await wire.answered("subscribe", "subscribed")
    state = (await states(wire, 2))[-1]
    check(
        set(entry(state, trial.robot)) == {"robot", "tick", "time", *told["fields"]},
        f"fields {sorted(entry(state, trial.robot))}",
    )
    check(entry(state, trial.robot)["holder"] is None, "nobody holds the robot, but there is a holder")
    await wire.answered("subscribe", "subscribed", fields=[])
    state = (await states(wire, 2))[-1]
    check(set(entry(state, trial.robot)) == {"robot", "tick", "time"}, "fields that were not asked for")


@case(
    "STA-8/holder",
    "Acquire, look, release, look",
    "holder is the session's name, then nil, in states after the answers",
    also=("STA-15", "LEA-11"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    state = await later(holder.wire, trial.robot)
    told = entry(state, trial.robot)["holder"]
    check(told == trial.name("holder"), f"holder is {told}")
    await holder.wire.answered("release", "lease", robot=trial.robot, fence=holder.fence)
    state = await later(holder.wire, trial.robot)
    check(entry(state, trial.robot)["holder"] is None, "a state after released shows a holder")


@case(
    "SUB-11/pause",
    "Subscribe to all robots and read nothing until 400 kB of states have passed; then read",
    "The client stays connected and finds the newest state behind few old ones",
    also=("SUB-8", "CON-11", "CON-12"),
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer", "slow")
    await wire.answered("subscribe", "subscribed")
    state = await later(wire, trial.robot)
    size = len(pack(state)) * len(trial.facts.description["robots"])
    count = math.ceil(_PASSED / size)
    if count * trial.facts.robot["period"] > _LONGEST_PAUSE:
        raise Skip("states are too small and too rare to fill what the client's own system keeps")
    wire.deaf(True)
    await trial.observer.ticks(trial.robot, count)
    newest = trial.observer.entries[trial.robot]["tick"]
    wire.deaf(False)
    ticks: list[int] = []
    while not ticks or ticks[-1] < newest:
        state = await wire.hear(lambda m: m["type"] == "state" and m["robot"] == trial.robot, "a state")
        ticks.append(state["tick"])
    room = _OWN / size + 10
    check(len(ticks) <= room, f"{len(ticks)} of {count} states were kept for a client that did not read")


@case(
    "STA-9/stops",
    "Stop the robot twice, for two reasons; lift one, lift the other",
    "stops lists exactly what is in force",
    also=("STA-15", "STP-3", "STP-7", "STP-12"),
)
async def _(trial: Trial) -> None:
    wire = await trial.operator()
    await wire.answered("subscribe", "subscribed", robots=[trial.robot])

    async def shown() -> list[int]:
        return sorted(entry(await later(wire, trial.robot), trial.robot)["stops"])

    stops = [
        (await wire.answered("stop", "stopped", robot=trial.robot, reason=reason))["stop"] for reason in "ab"
    ]
    check(stops[0] < stops[1], f"the ids were {stops}")
    check(await shown() == stops, "stops are not those told")
    await trial.rested()
    await trial.lifted(wire, stops[0])
    check(await shown() == stops[1:], "the other stop is not in force any more, or the first still is")
    await wire.refused("acquire", "stopped", robot=trial.robot)
    await trial.lifted(wire, stops[1])
    check(await shown() == [], "stops are in force after both were lifted")
    await wire.answered("acquire", "lease", robot=trial.robot)


@case(
    "STA-10/verdict",
    "Have a command admitted and one refused; look at the entry",
    "verdict tells seq and outcome of the newest, with the cause; counts count it",
    also=("STA-11", "STA-6"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    good = await holder.moved()
    state = await holder.applied(good)
    last: Any = entry(state, trial.robot)["verdict"]
    check((last["seq"], last["outcome"]) == (good["seq"], good["outcome"]), f"the entry tells {last}")
    before = entry(state, trial.robot)["counts"].get("refused:length", 0)
    bad = await holder.decided([])
    state = await later(holder.wire, trial.robot)
    shown = entry(state, trial.robot)
    last = shown["verdict"]
    told = (last["seq"], last["outcome"], last.get("cause"))
    check(told == (bad["seq"], "refused", "length"), f"the entry tells {told}")
    check(shown["counts"].get("refused:length", 0) == before + 1, f"counts are {shown['counts']}")
    check(shown["applied_seq"] == good["seq"], f"applied_seq is {shown['applied_seq']}")


@case(
    "STA-13/witness",
    "Move twenty ticks; look at the nearest pairs",
    "No distance is above that of the two points told with it; the limit is one of the description",
)
async def _(trial: Trial) -> None:
    # The true distance is at most that of any two points of the bodies, such as these.
    holder = await trial.holder()
    limits = {trial.facts.description[key] for key in ("stop_distance", "self_distance")}
    seen = 0
    for _ in range(20):
        await holder.moved(holder.small(0.2))
        for pair in entry(await holder.fresh(), trial.robot)["nearest"] or ():
            check(pair["limit"] in limits, f"the limit of {pair['pair']} is {pair['limit']}, not of {limits}")
            if pair.get("points"):
                seen += 1
                apart = math.dist(*pair["points"])
                check(
                    pair["distance"] <= apart + _ROUNDING,
                    f"{pair['pair']}: {pair['distance']} is told for points that are {apart} apart",
                )
    if not seen:
        raise Skip("no state told a pair with its points")


@case(
    "STA-12/late",
    "Move twenty ticks; look at late_commands",
    "It counts no command whose state showed it applied",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    before = entry(await holder.fresh(), trial.robot)["late_commands"]
    applied = 0
    for _ in range(20):
        verdict = await holder.moved(holder.small(0.2))
        applied += bool(await holder.applied(verdict))
    after = entry(await holder.fresh(), trial.robot)["late_commands"]
    check(
        after - before <= 20 - applied,
        f"late_commands went from {before} to {after} though all 20 were applied",
    )


@case(
    "STA-17/time",
    "Send ping, read a state, send ping",
    "The state's time is between those that the pongs tell, but for its own way",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    await wire.answered("subscribe", "subscribed", robots=[trial.robot], fields=[])
    wire.inbox.clear()
    first = await wire.answered("ping", "pong", time=0.0)
    # The tick may have been a moment before its state was sent.
    state = (await states(wire, 2))[-1]
    last = await wire.answered("ping", "pong", time=0.0)
    slack = 2 * trial.facts.robot["period"] + 0.25
    check(
        first["received"] - slack <= state["time"] <= last["sent"] + 1e-6,
        f"{first['received']} … {state['time']} … {last['sent']}",
    )
