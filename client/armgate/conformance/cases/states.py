"""Subscriptions and states."""

import itertools
import math
from functools import partial
from typing import Any

from armgate.conformance.case import Skip, Violation, case, check
from armgate.conformance.codec import Fields, pack
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import cause_of, entry_of, state_after_now

FIELDS = (
    "q", "setpoint", "applied_seq", "stop_end", "nearest", "least_clearance", "holder", "stops", "link", "verdict",
    "counts", "late_commands",
)  # fmt: skip
"""Fields of an entry in version 1, in addition to robot, tick and time."""

_ROUNDING = 1e-6
"""Tolerance of distances, m."""

_PAUSE = 1.0
"""Time for which a slow reader does not read, s."""


_PASSED, _BUFFERED, _LONGEST_PAUSE = 400_000, 130_000, 8.0
"""Bytes of states sent while a client does not read, bytes that its system may buffer, and the longest pause, s."""


async def states(client: Connection, count: int) -> list[Fields]:
    """Return the next states."""
    return [await client.receive(lambda m: m["type"] == "state", "a state") for _ in range(count)]


@case(
    "SUB-1/all",
    "Subscribe without every",
    "subscribed: every 1, all robots in order, the known fields",
    also=("SUB-2",),
)
async def subscription_defaults_to_everything(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    subscribed = await client.call("subscribe", "subscribed")
    names = [robot["name"] for robot in ctx.server.description["robots"]]
    check(subscribed["every"] == 1 and subscribed["robots"] == names, f"subscribed has {subscribed}")
    missing = set(FIELDS) - set(subscribed["fields"])
    check(not missing, f"these fields are missing: {sorted(missing)}")


@case(
    "SUB-1/some", "Subscribe to one robot and two fields", "subscribed repeats exactly these", also=("STA-4",)
)
async def subscription_repeats_what_was_requested(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    subscribed = await client.call(
        "subscribe", "subscribed", every=3, robots=[ctx.robot], fields=["q", "holder"]
    )
    check(subscribed["every"] == 3 and subscribed["robots"] == [ctx.robot], f"subscribed has {subscribed}")
    check(set(subscribed["fields"]) == {"q", "holder"}, f"fields are {subscribed['fields']}")


@case(
    "SUB-3/at-once",
    "Subscribe to every 10000th tick",
    "The newest state of each robot follows subscribed immediately",
)
async def subscription_sends_the_newest_states_at_once(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    await client.call("subscribe", "subscribed", every=10000)
    await client.sync()
    subscribed = await client.call("subscribe", "subscribed", every=10000)
    names = {robot["name"] for robot in ctx.server.description["robots"]}
    await client.call("ping", "pong", time=1.0)
    check(bool(subscribed), "no subscribed")
    client.send({"type": "subscribe", "every": 10000}, {"type": "ping", "id": 77, "time": 1.0})
    found: list[Fields] = []
    await client.receive(lambda m: found.append(m) or m.get("re") == 77, "pong")  # type: ignore[func-returns-value]
    about = [m["robot"] for m in found if m["type"] == "state"]
    check(set(about) == names, f"states of {sorted(set(about))} came at once; the cell has {sorted(names)}")


async def states_come_at_every_nth_tick(ctx: CaseContext, every: int) -> None:
    client = await ctx.client("observer")
    await client.call("subscribe", "subscribed", every=every, robots=[ctx.robot])
    found = (await states(client, 13))[1:]
    ticks = [state["tick"] for state in found]
    expected = list(range(ticks[0], ticks[0] + 12 * every, every))
    check(ticks == expected and ticks[0] % every == 0, f"ticks {ticks}, expected {expected}")
    times = [state["time"] for state in found]
    check(times == sorted(times), f"times {times}")
    names = [robot["name"] for robot in ctx.server.description["robots"]]
    for state in found:
        check(
            [one["robot"] for one in state["entries"]] == names,
            "entries are not those of all robots, in order",
        )
        own = entry_of(state, ctx.robot)
        check(
            (own["tick"], own["time"]) == (state["tick"], state["time"]),
            "the robot's entry is of another tick",
        )


for _every in (1, 3):
    case(
        f"SUB-4/every-{_every}",
        f"Subscribe with every = {_every} to the robot; read 12 states",
        f"Their ticks are all multiples of {_every}",
        also=("STA-2", "STA-3", "STA-1"),
    )(partial(states_come_at_every_nth_tick, every=_every))


@case(
    "SUB-5/replaced",
    "Subscribe to all, then with other fields, then with every 0",
    "Each replaces the previous subscription; after the last, no state comes",
    also=("SUB-4",),
)
async def subscription_replaces_the_previous_one(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    await client.call("subscribe", "subscribed")
    await client.call("subscribe", "subscribed", fields=["q"], robots=[ctx.robot])
    for state in await states(client, 5):
        check(
            set(entry_of(state, ctx.robot)) == {"robot", "tick", "time", "q"},
            f"an entry has {sorted(entry_of(state, ctx.robot))}",
        )
    await client.call("subscribe", "subscribed", every=0)
    await ctx.observer.ticks(ctx.robot, 10)
    await client.sync()
    check(not client.inbox, f"after every 0 came {[m['type'] for m in client.inbox]}")


@case(
    "SUB-6/unknown-field",
    "Subscribe; then subscribe with an unknown field and with an unknown robot",
    "Errors unknown_field and unknown_robot; the first subscription stays",
    also=("ERR-2",),
)
async def invalid_subscription_keeps_the_previous_one(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    await client.call("subscribe", "subscribed", fields=["holder"])
    await client.expect_refusal("subscribe", "unknown_field", fields=["q", "colour"])
    await client.expect_refusal("subscribe", "unknown_robot", robots=[ctx.robot, "kit-no-robot"])
    client.inbox.clear()
    for state in await states(client, 3):
        check(
            set(entry_of(state, ctx.robot)) == {"robot", "tick", "time", "holder"},
            "the first subscription is no longer in effect",
        )


@case("SUB-7/none", "Connect, acquire, command, and subscribe to nothing", "No state comes")
async def no_states_come_without_a_subscription(ctx: CaseContext) -> None:
    client = await ctx.client()
    lease = await client.call("acquire", "lease", robot=ctx.robot)
    command = {
        "robot": ctx.robot,
        "fence": lease["fence"],
        "seq": next(client.commands.seqs),
        "tick": ctx.observer.tick(ctx.robot),
    }
    client.send({"type": "command", **command, "dq": [0.0] * ctx.n})
    await client.expect("verdict")
    await ctx.observer.ticks(ctx.robot, 10)
    await client.sync()
    check(not any(m["type"] == "state" for m in client.inbox), "a state came without a subscription")


@case(
    "SUB-9/own",
    "Two sessions subscribe differently",
    "Each session receives the fields that it subscribed to",
)
async def each_session_has_its_own_subscription(ctx: CaseContext) -> None:
    one, two = await ctx.client("observer", "one"), await ctx.client("observer", "two")
    await one.call("subscribe", "subscribed", fields=["q"])
    await two.call("subscribe", "subscribed", every=2, fields=["holder", "stops"])
    for state in await states(one, 6):
        check(
            set(entry_of(state, ctx.robot)) == {"robot", "tick", "time", "q"},
            "the first session receives the fields of the second",
        )
    for state in (await states(two, 6))[1:]:
        check("q" not in entry_of(state, ctx.robot), "the second session receives the fields of the first")


@case(
    "SUB-8/slow",
    "Subscribe, request megabytes of answers, read nothing for 1 s, then read",
    "All answers come; of the states that waited only the newest come",
    also=("CON-11", "CON-12"),
)
async def slow_reader_gets_all_answers_and_the_newest_state(ctx: CaseContext) -> None:
    size = ctx.server.robot["urdf"]["size"]
    for megabytes in (0.6, 0.9, 1.4, 2.0, 2.8, 3.6, 4.4, 5.2, 6.0, 7.0):
        client = await ctx.client("observer", f"slow-{megabytes}")
        await client.call("subscribe", "subscribed", robots=[ctx.robot], fields=["q"])
        client.pause_reading()
        count = int(megabytes * 1e6 / size)
        asset = {"type": "asset", "hash": ctx.server.robot["urdf"]["hash"]}
        client.send(*({**asset, "id": 1000 + i} for i in range(count)))
        await ctx.observer.ticks(ctx.robot, int(_PAUSE / ctx.server.robot["period"]))
        client.resume_reading()
        found: list[Fields] = []
        try:
            client.send({"type": "ping", "id": 999, "time": 0.0})
            await client.receive(
                lambda m, found=found: found.append(m) or m.get("re") == 999,  # type: ignore[misc]
                "pong",
                within=60.0,
            )
        except Violation:
            if client.ended:
                raise Skip(
                    "the server closed a slow reader's connection before it had to omit states"
                ) from None
            raise
        answers = [m["re"] for m in found if m["type"] == "chunk"]
        check(
            answers == [1000 + i for i in range(count)],
            f"{len(answers)} of {count} answers came, or they came out of order",
        )
        found += await states(client, 3)  # the newest waiting state comes after all answers
        ticks = [m["tick"] for m in found if m["type"] == "state"]
        if any(b - a > 10 for a, b in itertools.pairwise(ticks)):
            return
        client.close()
    raise Skip("the kernel's buffers hold more than the kit sends: no state had to be omitted")


@case(
    "CON-11/overflow",
    "Request answers continuously and read none of them, while another session moves the robot",
    "The server closes the slow reader's connection; the moving session and the ticks are unaffected",
    also=("CON-12", "CON-9"),
)
async def reader_that_never_reads_is_disconnected(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    client = await ctx.client("observer", "reader")
    client.shrink_receive_buffer()
    client.pause_reading()
    asset = {"type": "asset", "hash": ctx.server.robot["urdf"]["hash"]}
    count, size = 0, ctx.server.robot["urdf"]["size"]
    while not client.ended and count * size < 256e6:
        client.send_unlogged(*[asset] * 100)
        count += 100
        verdict = await holder.command([0.0] * holder.n)
        check(cause_of(verdict) != "lease", "the mover lost its lease")
    check(
        count * size < 256e6 or client.ended,
        f"{count * size / 1e6:.0f} MB of answers wait and the session is still open",
    )
    await holder.move()


@case(
    "STA-4/null",
    "Check entries with all fields, and with none",
    "All subscribed fields are present, and holder is nil while no client holds the robot; without fields only robot, tick, time",
)
async def entries_hold_exactly_the_subscribed_fields(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    subscribed = await client.call("subscribe", "subscribed")
    state = (await states(client, 2))[-1]
    check(
        set(entry_of(state, ctx.robot)) == {"robot", "tick", "time", *subscribed["fields"]},
        f"fields {sorted(entry_of(state, ctx.robot))}",
    )
    check(entry_of(state, ctx.robot)["holder"] is None, "no client holds the robot, but there is a holder")
    await client.call("subscribe", "subscribed", fields=[])
    state = (await states(client, 2))[-1]
    check(set(entry_of(state, ctx.robot)) == {"robot", "tick", "time"}, "fields that were not subscribed to")


@case(
    "STA-8/holder",
    "Acquire, read a state, release, read a state",
    "holder is the session's name, then nil, in states after the answers",
    also=("STA-15", "LEA-11"),
)
async def states_show_the_holder(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    state = await state_after_now(holder.connection, ctx.robot)
    shown = entry_of(state, ctx.robot)["holder"]
    check(shown == ctx.name("holder"), f"holder is {shown}")
    await holder.connection.call("release", "lease", robot=ctx.robot, fence=holder.fence)
    state = await state_after_now(holder.connection, ctx.robot)
    check(entry_of(state, ctx.robot)["holder"] is None, "a state after released has a holder")


@case(
    "SUB-11/pause",
    "Subscribe to all robots and read nothing until 400 kB of states have passed; then read",
    "The client stays connected and receives the newest state after few old ones",
    also=("SUB-8", "CON-11", "CON-12"),
)
async def paused_reader_gets_the_newest_state(ctx: CaseContext) -> None:
    client = await ctx.client("observer", "slow")
    await client.call("subscribe", "subscribed")
    state = await state_after_now(client, ctx.robot)
    size = len(pack(state)) * len(ctx.server.description["robots"])
    count = math.ceil(_PASSED / size)
    if count * ctx.server.robot["period"] > _LONGEST_PAUSE:
        raise Skip("states are too small and too rare to fill the buffers of the client's system")
    client.pause_reading()
    await ctx.observer.ticks(ctx.robot, count)
    newest = ctx.observer.entries[ctx.robot]["tick"]
    client.resume_reading()
    ticks: list[int] = []
    while not ticks or ticks[-1] < newest:
        state = await client.receive(lambda m: m["type"] == "state" and m["robot"] == ctx.robot, "a state")
        ticks.append(state["tick"])
    room = _BUFFERED / size + 10
    check(len(ticks) <= room, f"{len(ticks)} of {count} states were kept for a client that did not read")


@case(
    "STA-9/stops",
    "Stop the robot twice, for two reasons; reset one, then the other",
    "stops lists exactly those in force",
    also=("STA-15", "STP-3", "STP-7", "STP-12"),
)
async def states_list_the_stops_in_force(ctx: CaseContext) -> None:
    client = await ctx.operator()
    await client.call("subscribe", "subscribed", robots=[ctx.robot])

    async def shown() -> list[int]:
        return sorted(entry_of(await state_after_now(client, ctx.robot), ctx.robot)["stops"])

    stops = [
        (await client.call("stop", "stopped", robot=ctx.robot, reason=reason))["stop"] for reason in "ab"
    ]
    check(stops[0] < stops[1], f"the ids were {stops}")
    check(await shown() == stops, "stops are not those of the answers")
    await ctx.wait_at_rest()
    await ctx.reset_stop(client, stops[0])
    check(await shown() == stops[1:], "the second stop is not in force any more, or the first one still is")
    await client.expect_refusal("acquire", "stopped", robot=ctx.robot)
    await ctx.reset_stop(client, stops[1])
    check(await shown() == [], "stops are in force after both were reset")
    await client.call("acquire", "lease", robot=ctx.robot)


@case(
    "STA-10/verdict",
    "Send a command that is admitted and one that is refused; check the entry",
    "verdict has seq, outcome and cause of the newest verdict; counts include it",
    also=("STA-11", "STA-6"),
)
async def states_show_the_newest_verdict_and_the_counts(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    good = await holder.move()
    state = await holder.state_applying(good)
    last: Any = entry_of(state, ctx.robot)["verdict"]
    check((last["seq"], last["outcome"]) == (good["seq"], good["outcome"]), f"the entry has {last}")
    before = entry_of(state, ctx.robot)["counts"].get("refused:length", 0)
    bad = await holder.command([])
    state = await state_after_now(holder.connection, ctx.robot)
    shown = entry_of(state, ctx.robot)
    last = shown["verdict"]
    found = (last["seq"], last["outcome"], last.get("cause"))
    check(found == (bad["seq"], "refused", "length"), f"the entry has {found}")
    check(shown["counts"].get("refused:length", 0) == before + 1, f"counts are {shown['counts']}")
    check(shown["applied_seq"] == good["seq"], f"applied_seq is {shown['applied_seq']}")


@case(
    "STA-13/witness",
    "Move twenty ticks; check the nearest pairs",
    "No distance exceeds that of its two witness points; the limit is one of those in the description",
)
async def distances_are_consistent_with_their_points(ctx: CaseContext) -> None:
    # The true distance is at most that of any two points of the bodies, and so of these two.
    holder = await ctx.holder()
    limits = {ctx.server.description[key] for key in ("stop_distance", "self_distance")}
    seen = 0
    for _ in range(20):
        await holder.move(holder.small_increment(0.2))
        for pair in entry_of(await holder.next_state(), ctx.robot)["nearest"] or ():
            check(pair["limit"] in limits, f"the limit of {pair['pair']} is {pair['limit']}, not of {limits}")
            if pair.get("points"):
                seen += 1
                apart = math.dist(*pair["points"])
                check(
                    pair["distance"] <= apart + _ROUNDING,
                    f"{pair['pair']}: {pair['distance']} is reported for points that are {apart} apart",
                )
    if not seen:
        raise Skip("no state had a pair with its points")


@case(
    "STA-12/late",
    "Move twenty ticks; check late_commands",
    "It does not count commands that a state showed as applied",
)
async def late_commands_are_not_applied(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    before = entry_of(await holder.next_state(), ctx.robot)["late_commands"]
    applied = 0
    for _ in range(20):
        verdict = await holder.move(holder.small_increment(0.2))
        applied += bool(await holder.state_applying(verdict))
    after = entry_of(await holder.next_state(), ctx.robot)["late_commands"]
    check(
        after - before <= 20 - applied,
        f"late_commands went from {before} to {after} although all 20 were applied",
    )


@case(
    "STA-17/time",
    "Send ping, read a state, send ping",
    "The time of the state is between those of the pongs, apart from the state's delay",
)
async def time_of_a_state_is_between_those_of_pongs(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    await client.call("subscribe", "subscribed", robots=[ctx.robot], fields=[])
    client.inbox.clear()
    first = await client.call("ping", "pong", time=0.0)
    # The tick may have happened a moment before its state was sent.
    state = (await states(client, 2))[-1]
    last = await client.call("ping", "pong", time=0.0)
    slack = 2 * ctx.server.robot["period"] + 0.25
    check(
        first["received"] - slack <= state["time"] <= last["sent"] + 1e-6,
        f"{first['received']} … {state['time']} … {last['sent']}",
    )
