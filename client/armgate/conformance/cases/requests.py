"""Requests and their answers in general, and the rights of each role."""

from functools import partial
from typing import Any

from armgate.conformance.case import case, check
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext


def requests(ctx: CaseContext) -> dict[str, tuple[dict[str, Any], str]]:
    """Return a request of every type that a controller may send, and the type of its answer."""
    return {
        "describe": ({}, "description"),
        "asset": ({"hash": ctx.server.robot["urdf"]["hash"], "length": 16}, "chunk"),
        "subscribe": ({"every": 0}, "subscribed"),
        "signal": ({"name": ctx.name("s"), "value": [1.0]}, "signaled"),
        "acquire": ({"robot": ctx.robot}, "lease"),
        "ping": ({"time": 1.5}, "pong"),
        "stop": ({"robot": ctx.robot, "reason": "requested"}, "stopped"),
    }


@case(
    "MSG-2/all",
    "Send a request of every type, including release and reset",
    "Each is answered once, by the type that the specification requires",
    also=("MSG-3",),
)
async def every_request_is_answered_once(ctx: CaseContext) -> None:
    client = await ctx.operator()
    for kind, (fields, answer) in requests(ctx).items():
        message = await client.call(kind, answer, **fields)
        if kind == "acquire":
            await client.call("release", "lease", robot=ctx.robot, fence=message["fence"])
    await ctx.wait_at_rest()
    await ctx.reset_stop(client, message["stop"])
    await client.sync()
    left = [m for m in client.inbox if m.get("re") is not None]
    check(not left, f"more answers than requests: {left}")


@case(
    "MSG-4/without-id",
    "Send the same requests without id",
    "Each is processed and answered without re",
    also=("MSG-5",),
)
async def request_without_id_is_answered_without_re(ctx: CaseContext) -> None:
    client = await ctx.client()
    for kind, (fields, answer) in requests(ctx).items():
        client.send({"type": kind, **fields})
        message = await client.expect(answer) if answer != "stopped" else await _stopped(client)
        check(message.get("re") is None, f"{answer} answers request {message.get('re')}, which was not made")


async def _stopped(client: Connection) -> Any:
    return await client.receive(lambda m: m["type"] == "stopped", "stopped")


@case(
    "MSG-5/others",
    "One session requests a stop; another one observes",
    "stopped has re for the session that requested it, but not for the observer",
)
async def broadcast_to_others_has_no_re(ctx: CaseContext) -> None:
    other = await ctx.client("observer", "other")
    requester = await ctx.client()
    await requester.call("stop", "stopped", robot=ctx.robot)
    message = await _stopped(other)
    check(message.get("re") is None, f"the other session received re {message.get('re')}")


@case("MSG-6/order", "Send ten different requests in one write", "Ten answers in that order")
async def requests_are_answered_in_order(ctx: CaseContext) -> None:
    client = await ctx.client()
    kinds = [
        "ping",
        "describe",
        "ping",
        "subscribe",
        "asset",
        "ping",
        "describe",
        "subscribe",
        "asset",
        "ping",
    ]
    known = requests(ctx)
    client.send(*({"type": kind, "id": 500 + i, **known[kind][0]} for i, kind in enumerate(kinds)))
    for i, kind in enumerate(kinds):
        await client.expect(known[kind][1], re=500 + i)


@case("MSG-7/same-id", "Send three pings with the same id in one write", "Three pongs with that id")
async def requests_with_the_same_id_are_all_answered(ctx: CaseContext) -> None:
    client = await ctx.client()
    for time in (1.0, 2.0, 3.0):
        client.send({"type": "ping", "id": 9, "time": time})
    for time in (1.0, 2.0, 3.0):
        await client.expect("pong", re=9, time=time)


@case(
    "MSG-3/largest-id",
    "Send pings with the ids 0 and 2**31 - 1, then 2**31",
    "re repeats the first two; the third is invalid",
)
async def largest_id_is_repeated_and_a_larger_one_refused(ctx: CaseContext) -> None:
    client = await ctx.client()
    for number in (0, 2**31 - 1):
        client.send({"type": "ping", "id": number, "time": 1.0})
        await client.expect("pong", re=number)
    client.send({"type": "ping", "id": 2**31, "time": 1.0})
    await client.expect("error", code="invalid_message", fatal=False)


@case(
    "MSG-9/observer",
    "As an observer: describe, asset, subscribe, ping, stop, bye",
    "All are answered",
    also=("STP-1",),
)
async def observer_may_read_and_stop(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    known = requests(ctx)
    for kind in ("describe", "asset", "subscribe", "ping", "stop"):
        fields, answer = known[kind]
        await client.call(kind, answer, **fields)
    client.send({"type": "bye"})
    kinds = [m["type"] for m in await client.receive_until_closed()]
    check(kinds[-1:] == ["bye"], f"the last message was {kinds[-1:]}")


_FORBIDDEN: dict[str, tuple[str, str, str, dict[str, Any], tuple[str, ...]]] = {
    "LEA-6/acquire": ("observer", "acquire", "the robot", {"robot": "R"}, ()),
    "LEA-6/release": ("observer", "release", "the robot", {"robot": "R", "fence": 1}, ()),
    "SIG-2/observer": ("observer", "signal", "a number", {"name": "kit/forbidden", "value": [1.0]}, ()),
    "STP-8/observer": ("observer", "reset", "a stop", {"stop": 1}, ()),
    "STP-8/controller": ("controller", "reset", "a stop", {"stop": 1}, ()),
    "LEA-7/free": (
        "controller",
        "acquire",
        "a free robot with takeover",
        {"robot": "R", "takeover": True},
        (),
    ),
}


async def request_of_a_lower_role_is_forbidden(
    ctx: CaseContext, role: str, kind: str, fields: dict[str, Any]
) -> None:
    client = await ctx.client(role)
    named = fields | ({"robot": ctx.robot} if "robot" in fields else {})
    error = await client.expect_refusal(kind, "forbidden", **named)
    check(error.get("about") == kind, f"about is {error.get('about')}")
    await client.sync()
    await ctx.observer.ticks(ctx.robot, 1)
    check(ctx.entry()["holder"] is None, "the robot is held")


for _id, (_role, _kind, _what, _fields, _also) in _FORBIDDEN.items():
    case(
        _id,
        f"As {_role}, {_kind} {_what}",
        "An error forbidden, not fatal, without effect",
        also=("MSG-10", "ERR-2", "ERR-6"),
    )(partial(request_of_a_lower_role_is_forbidden, role=_role, kind=_kind, fields=_fields))


@case(
    "ERR-1/fatal",
    "Provoke five different errors that are not fatal",
    "No error is fatal, and the connection stays open",
    also=("ERR-2",),
)
async def errors_that_are_not_fatal_keep_the_connection(ctx: CaseContext) -> None:
    client = await ctx.client()
    await client.expect_refusal("teleport", "unknown_type")
    await client.expect_refusal("acquire", "unknown_robot", robot="kit-no-robot")
    await client.expect_refusal("subscribe", "unknown_field", fields=["colour"])
    await client.expect_refusal("release", "not_held", robot=ctx.robot, fence=1)
    await client.expect_refusal("asset", "unknown_asset", hash="0" * 64)
    await client.sync()


@case("ERR-6/about", "Provoke errors about four types", "about names the type each time", also=("ERR-7",))
async def error_names_the_type_of_the_request(ctx: CaseContext) -> None:
    client = await ctx.client()
    requests_: dict[str, dict[str, Any]] = {
        "acquire": {"robot": "kit-no-robot"},
        "release": {"robot": ctx.robot, "fence": 1},
        "subscribe": {"robots": ["kit-no-robot"]},
        "reset": {"stop": 1},
    }
    for kind, fields in requests_.items():
        error = await client.request(kind, **fields)
        check(error["type"] == "error" and error.get("about") == kind, f"{kind}: {error}")


_NO_ROBOT: dict[str, dict[str, Any]] = {
    "acquire": {"robot": "kit-no-robot"},
    "release": {"robot": "kit-no-robot", "fence": 1},
    "stop": {"robot": "kit-no-robot"},
    "subscribe": {"robots": ["kit-no-robot"]},
}


async def unknown_robot_is_refused(ctx: CaseContext, kind: str, fields: dict[str, Any]) -> None:
    client = await ctx.client()
    await client.expect_refusal(kind, "unknown_robot", **fields)
    await client.sync()
    await ctx.observer.ticks(ctx.robot, 1)
    check(not ctx.observer.stops(), "there is a stop")


for _kind, _fields in _NO_ROBOT.items():
    case(
        f"LEA-9/{_kind}",
        f"Send {_kind} with a robot that the cell does not have",
        "An error unknown_robot, not fatal",
        also=("ERR-2",),
    )(partial(unknown_robot_is_refused, kind=_kind, fields=_fields))


@case("LCK-13/pass", "Send pass to a server that runs by the wall clock", "An error no_lockstep, not fatal")
async def pass_without_lockstep_is_refused(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send({"type": "pass", "step": 1})
    await client.expect("error", code="no_lockstep", fatal=False, about="pass")
    await client.sync()


@case(
    "LCK-1/clock",
    "On a server that runs by the wall clock, check welcome and three states",
    "lockstep is not true, and states have no step",
)
async def states_without_lockstep_have_no_step(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    check(client.welcome.get("lockstep") is not True, "lockstep is true in welcome")
    await client.call("subscribe", "subscribed", fields=[])
    for _ in range(3):
        state = await client.receive(lambda m: m["type"] == "state", "a state")
        check(state.get("step") is None, f"a state has the step {state.get('step')}")


@case(
    "PNG-1/bits",
    "Send pings with times that are hard to represent",
    "Each pong repeats its time, bit for bit",
)
async def pong_repeats_the_time_bit_for_bit(ctx: CaseContext) -> None:
    client = await ctx.client()
    for time in (0.1, -0.0, 5e-324, 1.7976931348623157e308, -1e-9, 1 / 3, 123456789.123456789):
        pong = await client.call("ping", "pong", time=time)
        check(float(pong["time"]).hex() == time.hex(), f"sent {time.hex()}, got {float(pong['time']).hex()}")


@case("PNG-1/integers", "Send pings with integers as times", "Each pong repeats the nearest 64-bit float")
async def pong_repeats_an_integer_as_a_float(ctx: CaseContext) -> None:
    client = await ctx.client()
    for time in (0, 1, -(2**63), 2**53 + 1, 2**64 - 1):
        pong = await client.call("ping", "pong", time=time)
        check(pong["time"] == float(time), f"sent {time}, got {pong['time']!r}")


@case("PNG-2/clock", "Send 20 pings", "received is never after sent, and neither decreases")
async def times_of_pongs_never_decrease(ctx: CaseContext) -> None:
    client = await ctx.client()
    last = float("-inf")
    for _ in range(20):
        pong = await client.call("ping", "pong", time=1.0)
        check(last <= pong["received"] <= pong["sent"], f"{last} then {pong['received']} then {pong['sent']}")
        last = pong["sent"]


@case(
    "CON-15/fast",
    "Send 3000 pings as fast as the connection accepts them",
    "3000 pongs in their order",
    also=("MSG-6",),
)
async def pings_at_full_speed_are_answered_in_order(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send(*({"type": "ping", "id": 1000 + i, "time": float(i)} for i in range(3000)))
    for i in range(3000):
        await client.expect("pong", re=1000 + i, time=float(i))
