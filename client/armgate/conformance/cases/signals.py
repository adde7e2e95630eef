"""Signals: owner, rate, and number."""

import math
from functools import partial
from typing import Any

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.context import CaseContext
from armgate.conformance.lease_holder import state_after_now

_SIGNALS = 64
"""Signals that a state can hold."""


async def signal_in_states(ctx: CaseContext, name: str) -> Fields | None:
    """Return a signal from the next states of a new observer; None if it is not there."""
    client = await ctx.client("observer", f"observer-{len(ctx.connections)}")
    await client.call("subscribe", "subscribed", robots=[ctx.robot], fields=[])
    state = await state_after_now(client, ctx.robot)
    client.close()
    signals: dict[str, Fields] = state.get("signals") or {}
    return signals.get(name)


@case(
    "SIG-1/shared",
    "Set a signal twice, to one number and to sixteen",
    "signaled; states show owner, newest value and time",
    also=("STA-14", "STA-15"),
)
async def signal_is_shown_in_states(ctx: CaseContext) -> None:
    client = await ctx.client()
    name = ctx.name("zoom")
    for value in ([1.5], [float(i) for i in range(16)]):
        answer = await client.call("signal", "signaled", name=name, value=value)
        check(answer["name"] == name, f"signaled {answer['name']}")
        seen = await signal_in_states(ctx, name)
        check(seen is not None, "the signal is not in the states")
        assert seen is not None
        check((seen["owner"], seen["value"]) == (ctx.name("client"), value), f"the states have {seen}")


@case(
    "SIG-3/owned",
    "Another session sets the same signal, also after the owner has set it again",
    "An error signal_owned; the value stays",
    also=("ERR-2",),
)
async def signal_of_another_session_cannot_be_set(ctx: CaseContext) -> None:
    owner, other = await ctx.client(name="owner"), await ctx.client(name="other")
    name = ctx.name("zoom")
    await owner.call("signal", "signaled", name=name, value=[1.0])
    await other.expect_refusal("signal", "signal_owned", name=name, value=[2.0])
    await owner.call("signal", "signaled", name=name, value=[3.0])
    seen = await signal_in_states(ctx, name)
    check(seen is not None and seen["value"] == [3.0], f"the states have {seen}")


@case(
    "SIG-4/gone",
    "Set a signal, close; another session sets it",
    "It disappears from the states; then the other session owns it",
)
async def signals_end_with_their_session(ctx: CaseContext) -> None:
    owner, other = await ctx.client(name="owner"), await ctx.client(name="other")
    name = ctx.name("zoom")
    await owner.call("signal", "signaled", name=name, value=[1.0])
    owner.send({"type": "bye"})
    await owner.receive_until_closed()
    check(await signal_in_states(ctx, name) is None, "the signal of an ended session is still in the states")
    await other.call("signal", "signaled", name=name, value=[2.0])


async def invalid_signal_is_refused(ctx: CaseContext, value: Any) -> None:
    client = await ctx.client()
    name = ctx.name("odd")
    await client.expect_refusal("signal", "invalid_message", name=name, value=value)
    check(await signal_in_states(ctx, name) is None, "the signal is in the states")


for _slug, _value in {
    "empty": [],
    "seventeen": [0.0] * 17,
    "nan": [math.nan],
    "text": ["1"],
    "scalar": 1.0,
}.items():
    case(
        f"SIG-5/{_slug}",
        f"Set a signal to {_value}",
        "An error invalid_message, not fatal; no signal",
        also=("ERR-4",),
    )(partial(invalid_signal_is_refused, value=_value))


@case(
    "SIG-6/full",
    "Set one signal more than the limit",
    "An error too_many_signals, not fatal; the earlier signals stay and can be set again",
)
async def signals_of_a_session_are_limited(ctx: CaseContext) -> None:
    limit = ctx.server.welcome["limits"]["signals"]
    client = await ctx.client()
    for i in range(limit):
        answer = await client.request("signal", name=ctx.name(f"s{i}"), value=[float(i)])
        if answer.get("code") == "signal_rate":
            raise Skip("the signal rate is too low to reach the limit")
        check(answer["type"] == "signaled", f"signal {i} of {limit}: {answer}")
    await client.expect_refusal("signal", "too_many_signals", name=ctx.name("more"), value=[0.0])
    await client.call("signal", "signaled", name=ctx.name("s0"), value=[9.0])


@case(
    "SIG-9/operator",
    "As controller, set a signal whose name begins with operator.",
    "An error forbidden, not fatal; no signal",
)
async def controller_cannot_set_an_operator_signal(ctx: CaseContext) -> None:
    client = await ctx.client()
    name = f"operator.{ctx.name('reserved')}"
    await client.expect_refusal("signal", "forbidden", name=name, value=[1.0])
    check(await signal_in_states(ctx, name) is None, "the signal is in the states")


@case(
    "SIG-11/all",
    f"From two sessions, set more signals than {_SIGNALS} together",
    f"Not more than {_SIGNALS} are accepted; then an error too_many_signals, not fatal",
)
async def signals_of_all_sessions_are_limited(ctx: CaseContext) -> None:
    taken = 0
    for owner in ("one", "other"):
        client = await ctx.client("controller", owner)
        for i in range(_SIGNALS + 1):
            answer = await client.request("signal", name=ctx.name(f"{owner}{i}"), value=[float(i)])
            if answer.get("code") == "signal_rate":
                raise Skip("the signal rate is too low to reach the limit")
            if answer.get("code") == "too_many_signals":
                break
            taken += 1
    check(answer.get("code") == "too_many_signals", f"{taken} signals were accepted")
    check(taken <= _SIGNALS, f"{taken} signals were accepted")


@case(
    "SIG-7/rate",
    "Send signals in one write, three times as many as allowed per second and ten more",
    "Some are refused by signal_rate, not fatal; each is answered; the connection stays open",
)
async def signals_above_the_rate_are_refused(ctx: CaseContext) -> None:
    rate = ctx.server.welcome["limits"]["signal_rate"]
    if rate > 20_000:
        raise Skip(f"the limit of {rate:g} signals per second is higher than the kit can send")
    client = await ctx.client()
    count = int(3 * rate) + 10
    client.send(
        *(
            {"type": "signal", "id": 1000 + i, "name": ctx.name("fast"), "value": [float(i)]}
            for i in range(count)
        )
    )
    answers = [await client.answer_to(1000 + i) for i in range(count)]
    refusals = [a for a in answers if a["type"] == "error"]
    check(
        all(a["code"] == "signal_rate" and not a["fatal"] for a in refusals), f"another error: {refusals[:1]}"
    )
    check(answers[0]["type"] == "signaled", f"the first was answered by {answers[0]}")
    if not refusals:
        raise Skip("the server reads messages too slowly to exceed the rate")
    await client.sync()


@case("SIG-7/slow", "Send signals at a fifth of the rate", "All are accepted")
async def signals_below_the_rate_are_accepted(ctx: CaseContext) -> None:
    rate = ctx.server.welcome["limits"]["signal_rate"]
    period = ctx.server.robot["period"]
    client = await ctx.client()
    for i in range(10):
        await client.call("signal", "signaled", name=ctx.name("slow"), value=[float(i)])
        await ctx.observer.ticks(ctx.robot, max(1, round(5 / rate / period)))


@case(
    "SIG-8/verdict",
    "Send the same command before and after signals of every kind",
    "The verdicts are the same",
)
async def signals_do_not_change_verdicts(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    found = []
    for names in ((), ("distance", "repulsion", "beta", ctx.robot)):
        for name in names:
            await holder.connection.request("signal", name=name, value=[0.0, 1e9])
        await ctx.wait_at_rest()
        verdict = await holder.command([0.0] * holder.n)
        found.append((verdict["outcome"], verdict["beta"], verdict["dq"], verdict.get("reasons")))
    check(found[0] == found[1], f"before {found[0]}, after {found[1]}")
