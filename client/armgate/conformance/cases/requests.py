"""Requests and their answers, whatever they ask for; what each role may do."""

from typing import Any

from armgate.conformance.case import case
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import check
from armgate.conformance.wire import Wire


def requests(trial: Trial) -> dict[str, tuple[dict[str, Any], str]]:
    """A request of every type that a controller may make, and the type of its answer."""
    return {
        "describe": ({}, "description"),
        "asset": ({"hash": trial.facts.robot["urdf"]["hash"], "length": 16}, "chunk"),
        "subscribe": ({"every": 0}, "subscribed"),
        "signal": ({"name": trial.name("s"), "value": [1.0]}, "signaled"),
        "acquire": ({"robot": trial.robot}, "lease"),
        "ping": ({"time": 1.5}, "pong"),
        "stop": ({"robot": trial.robot, "reason": "asked"}, "stopped"),
    }


@case(
    "MSG-2/all",
    "Make a request of every type, release and reset too",
    "Each is answered once, by what the table says",
    also=("MSG-3",),
)
async def _(trial: Trial) -> None:
    wire = await trial.operator()
    for kind, (fields, answer) in requests(trial).items():
        told = await wire.answered(kind, answer, **fields)
        if kind == "acquire":
            await wire.answered("release", "lease", robot=trial.robot, fence=told["fence"])
    await trial.rested()
    await trial.lifted(wire, told["stop"])
    await wire.in_step()
    left = [m for m in wire.inbox if m.get("re") is not None]
    check(not left, f"more answers than requests: {left}")


@case(
    "MSG-4/without-id",
    "Make the same requests without id",
    "Each is done and answered without re",
    also=("MSG-5",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    for kind, (fields, answer) in requests(trial).items():
        wire.say({"type": kind, **fields})
        told = await wire.expect(answer) if answer != "stopped" else await _stopped(wire)
        check(told.get("re") is None, f"{answer} answers request {told.get('re')}, which nobody made")


async def _stopped(wire: Wire) -> Any:
    return await wire.hear(lambda m: m["type"] == "stopped", "stopped")


@case(
    "MSG-5/others",
    "One asks for a stop; another looks on",
    "The other one's stopped has no re, the asker's has",
)
async def _(trial: Trial) -> None:
    other = await trial.client("observer", "other")
    asker = await trial.client()
    await asker.answered("stop", "stopped", robot=trial.robot)
    told = await _stopped(other)
    check(told.get("re") is None, f"the other session was told re {told.get('re')}")


@case("MSG-6/order", "Send ten different requests in one write", "Ten answers in that order")
async def _(trial: Trial) -> None:
    wire = await trial.client()
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
    known = requests(trial)
    wire.say(*({"type": kind, "id": 500 + i, **known[kind][0]} for i, kind in enumerate(kinds)))
    for i, kind in enumerate(kinds):
        await wire.expect(known[kind][1], re=500 + i)


@case("MSG-7/same-id", "Send three pings with the same id in one write", "Three pongs with that id")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    for time in (1.0, 2.0, 3.0):
        wire.say({"type": "ping", "id": 9, "time": time})
    for time in (1.0, 2.0, 3.0):
        await wire.expect("pong", re=9, time=time)


@case(
    "MSG-3/largest-id",
    "Send pings with the ids 0 and 2**31 - 1, then 2**31",
    "re repeats the first two; the third is invalid",
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    for number in (0, 2**31 - 1):
        wire.say({"type": "ping", "id": number, "time": 1.0})
        await wire.expect("pong", re=number)
    wire.say({"type": "ping", "id": 2**31, "time": 1.0})
    await wire.expect("error", code="invalid_message", fatal=False)


@case(
    "MSG-9/observer",
    "As an observer: describe, asset, subscribe, ping, stop, bye",
    "All are answered",
    also=("STP-1",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    known = requests(trial)
    for kind in ("describe", "asset", "subscribe", "ping", "stop"):
        fields, answer = known[kind]
        await wire.answered(kind, answer, **fields)
    wire.say({"type": "bye"})
    told = [m["type"] for m in await wire.ends()]
    check(told[-1:] == ["bye"], f"the last message was {told[-1:]}")


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

for _id, (_role, _kind, _what, _fields, _also) in _FORBIDDEN.items():

    @case(
        _id,
        f"As {_role}, {_kind} {_what}",
        "A forbidden, not fatal, without effect",
        also=("MSG-10", "ERR-2", "ERR-6"),
    )
    async def _(trial: Trial, role: str = _role, kind: str = _kind, fields: dict[str, Any] = _fields) -> None:
        wire = await trial.client(role)
        named = fields | ({"robot": trial.robot} if "robot" in fields else {})
        error = await wire.refused(kind, "forbidden", **named)
        check(error.get("about") == kind, f"about is {error.get('about')}")
        await wire.in_step()
        await trial.observer.ticks(trial.robot, 1)
        check(trial.entry()["holder"] is None, "the robot is held")


@case(
    "ERR-1/fatal",
    "Provoke five different errors that are not fatal",
    "None is, and the connection stays",
    also=("ERR-2",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    await wire.refused("teleport", "unknown_type")
    await wire.refused("acquire", "unknown_robot", robot="kit-no-robot")
    await wire.refused("subscribe", "unknown_field", fields=["colour"])
    await wire.refused("release", "not_held", robot=trial.robot, fence=1)
    await wire.refused("asset", "unknown_asset", hash="0" * 64)
    await wire.in_step()


@case("ERR-6/about", "Provoke errors about four types", "about names the type each time", also=("ERR-7",))
async def _(trial: Trial) -> None:
    wire = await trial.client()
    asked: dict[str, dict[str, Any]] = {
        "acquire": {"robot": "kit-no-robot"},
        "release": {"robot": trial.robot, "fence": 1},
        "subscribe": {"robots": ["kit-no-robot"]},
        "reset": {"stop": 1},
    }
    for kind, fields in asked.items():
        error = await wire.ask(kind, **fields)
        check(error["type"] == "error" and error.get("about") == kind, f"{kind}: {error}")


_NO_ROBOT: dict[str, dict[str, Any]] = {
    "acquire": {"robot": "kit-no-robot"},
    "release": {"robot": "kit-no-robot", "fence": 1},
    "stop": {"robot": "kit-no-robot"},
    "subscribe": {"robots": ["kit-no-robot"]},
}

for _kind, _fields in _NO_ROBOT.items():

    @case(
        f"LEA-9/{_kind}",
        f"{_kind} with a robot that the cell does not have",
        "An unknown_robot, not fatal",
        also=("ERR-2",),
    )
    async def _(trial: Trial, kind: str = _kind, fields: dict[str, Any] = _fields) -> None:
        wire = await trial.client()
        await wire.refused(kind, "unknown_robot", **fields)
        await wire.in_step()
        await trial.observer.ticks(trial.robot, 1)
        check(not trial.observer.stops(), "there is a stop")


@case("LCK-13/pass", "Send pass to a server by the wall clock", "A no_lockstep, not fatal")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    wire.say({"type": "pass", "step": 1})
    await wire.expect("error", code="no_lockstep", fatal=False, about="pass")
    await wire.in_step()


@case(
    "LCK-1/clock",
    "On a server by the wall clock, look at welcome and a state",
    "lockstep is not true, and states have no step",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    check(wire.welcome.get("lockstep") is not True, "welcome says lockstep")
    await wire.answered("subscribe", "subscribed", fields=[])
    for _ in range(3):
        state = await wire.hear(lambda m: m["type"] == "state", "a state")
        check(state.get("step") is None, f"a state has the step {state.get('step')}")


@case("PNG-1/bits", "Send pings with times that are hard to keep", "Each pong repeats its time, bit for bit")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    for time in (0.1, -0.0, 5e-324, 1.7976931348623157e308, -1e-9, 1 / 3, 123456789.123456789):
        pong = await wire.answered("ping", "pong", time=time)
        check(float(pong["time"]).hex() == time.hex(), f"sent {time.hex()}, got {float(pong['time']).hex()}")


@case("PNG-1/integers", "Send pings with integers as times", "Each pong repeats the nearest 64-bit float")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    for time in (0, 1, -(2**63), 2**53 + 1, 2**64 - 1):
        pong = await wire.answered("ping", "pong", time=time)
        check(pong["time"] == float(time), f"sent {time}, got {pong['time']!r}")


@case("PNG-2/clock", "Send 20 pings", "received is never after sent, and neither goes back")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    last = float("-inf")
    for _ in range(20):
        pong = await wire.answered("ping", "pong", time=1.0)
        check(last <= pong["received"] <= pong["sent"], f"{last} then {pong['received']} then {pong['sent']}")
        last = pong["sent"]


@case(
    "CON-15/fast",
    "Send 3000 pings as fast as the connection takes them",
    "3000 pongs in their order",
    also=("MSG-6",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    wire.say(*({"type": "ping", "id": 1000 + i, "time": float(i)} for i in range(3000)))
    for i in range(3000):
        await wire.expect("pong", re=1000 + i, time=float(i))
