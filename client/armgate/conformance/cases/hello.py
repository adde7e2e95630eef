"""Hello, versions, and how a connection ends."""

from typing import Any

from armgate.conformance.case import case
from armgate.conformance.packing import frame, pack
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check

_PATIENT = 15.0
"""How long a server may take to close on a silent client, s; the kit does not know its bound."""

_MANY = 300
"""How many connections the kit opens to find out how many there may be."""


@case(
    "HEL-3/first",
    "Say hello and then describe at once after the welcome",
    "One welcome, before anything else",
)
async def _(trial: Trial) -> None:
    wire = await trial.open()
    wire.say(trial.target.hello(trial.name("first"), "controller"))
    first = await wire.hear(lambda m: True, "welcome")
    check(first["type"] == "welcome", f"the first message was {first['type']}")
    await wire.answered("describe", "description")


@case(
    "HEL-17/packet",
    "Send hello and a ping in one write",
    "The welcome, then the pong",
    also=("HEL-3", "FRM-2"),
)
async def _(trial: Trial) -> None:
    wire = await trial.open()
    ping = {"type": "ping", "id": 7, "time": 1.0}
    wire.say(trial.target.hello(trial.name("first"), "controller"), ping)
    first = await wire.hear(lambda m: True, "welcome")
    check(first["type"] == "welcome", f"the first message was {first['type']}")
    second = await wire.answer_to(7)
    check(second["type"] == "pong", f"the ping was answered by {second}")


_BEFORE: dict[str, dict[str, Any]] = {
    "ping": {"time": 1.0},
    "describe": {},
    "acquire": {"robot": "R"},
    "command": {"robot": "R", "fence": 1, "seq": 1, "tick": 1, "dq": [0.0]},
    "stop": {"reason": "before hello"},
    "subscribe": {},
    "reset": {"stop": 1},
}

for _kind, _fields in _BEFORE.items():

    @case(
        f"HEL-4/{_kind}",
        f"Begin with {_kind} instead of hello",
        "A fatal unexpected; no effect",
        also=("HEL-15",),
    )
    async def _(trial: Trial, kind: str = _kind, fields: dict[str, Any] = _fields) -> None:
        wire = await trial.open()
        wire.write(pack({"type": kind, **fields}), f"{kind} before hello")
        await wire.fails("unexpected")
        await trial.observer.ticks(trial.robot, 2)
        check(not trial.observer.stops(), "a stop before hello is in force")
        check(trial.entry()["holder"] is None, "an acquire before hello gave the robot")


@case(
    "HEL-6/again",
    "Say hello a second time, while holding the robot",
    "A fatal unexpected; the robot is free",
    also=("CON-2",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    holder.wire.say(trial.target.hello(trial.name("again"), "operator"))
    await holder.wire.fails("unexpected")
    await trial.freed()


@case(
    "CON-2/unexpected", "Say hello twice in one write", "A welcome, then a fatal unexpected", also=("CON-1",)
)
async def _(trial: Trial) -> None:
    wire = await trial.open()
    hello = trial.target.hello(trial.name("twice"), "observer")
    wire.say(hello, hello)
    found = await wire.ends()
    told = [(m["type"], m.get("code")) for m in found]
    check(
        told == [("welcome", None), ("error", "unexpected")], f"expected welcome and unexpected, got {told}"
    )


@case("HEL-7/role", "Say hello in each role", "The welcome names the role, below tokens or as asked")
async def _(trial: Trial) -> None:
    for role in ("observer", "controller", "operator"):
        wire = await trial.client(role, role)
        check(wire.welcome["role"] == role, f"asked for {role}, the welcome says {wire.welcome['role']}")
        check(wire.welcome["name"] == trial.name(role), f"the welcome's name is {wire.welcome['name']}")


@case("HEL-8/default", "Say hello without a role, then acquire", "The session is a controller's")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    hello = trial.target.hello(trial.name("bare"), "controller")
    del hello["role"]
    wire.say(hello)
    welcome = await wire.expect("welcome")
    check(welcome["role"] == "controller", f"the role is {welcome['role']}")
    await wire.answered("acquire", "lease", robot=trial.robot)


@case(
    "HEL-9/sessions",
    "Connect eight times",
    "Every session has an id of its own; start is the same",
    also=("HEL-10",),
)
async def _(trial: Trial) -> None:
    wires = [await trial.client("observer", f"c{i}") for i in range(8)]
    sessions = {wire.welcome["session"] for wire in wires}
    check(len(sessions) == 8, f"8 sessions have the ids {sorted(sessions)}")
    starts = {wire.welcome["start"] for wire in wires}
    check(starts == {trial.facts.welcome["start"]}, f"start differs: {starts}")


@case("HEL-11/anew", "Start another server of the kind and say hello there", "Its start is another one")
async def _(trial: Trial) -> None:
    async with trial.anew() as target:
        wire = await trial.visit(target, trial.name("anew"), "observer")
        check(wire.welcome["start"] != trial.facts.welcome["start"], "two starts have the same name")


@case(
    "HEL-12/limits", "Look at the limits in welcome", "inbound 65536, outbound 1048576, the others sensible"
)
async def _(trial: Trial) -> None:
    limits = (await trial.client("observer")).welcome["limits"]
    check(limits["inbound"] == 65536, f"inbound is {limits['inbound']}")
    check(limits["outbound"] == 1048576, f"outbound is {limits['outbound']}")
    check(limits["lease_ttl"] > 0 and limits["signal_rate"] > 0, "lease_ttl and signal_rate must be positive")


@case("HEL-13/silent", "Connect and say nothing", "A fatal handshake_timeout within 15 s")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    await wire.fails("handshake_timeout", within=_PATIENT + trial.target.patience)


@case("HEL-13/drip", "Connect and send 3 bytes of a frame", "A fatal handshake_timeout within 15 s")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    wire.write(b"\x00\x00\x00", "3 bytes of a length")
    await wire.fails("handshake_timeout", within=_PATIENT + trial.target.patience)


@case(
    "HEL-14/full",
    f"Open connections until one is refused, {_MANY} at most; then close them and come again",
    "One more than there may be is told too_many; nobody else notices; there is room again afterwards",
    also=("SEC-11", "CON-9"),
)
async def _(trial: Trial) -> None:
    observed = await trial.client("observer", "watcher")
    for number in range(_MANY):
        wire = await trial.open(f"c{number}")
        wire.say(trial.target.hello(trial.name(f"c{number}"), "observer"))
        if (await wire.expect("welcome", "error"))["type"] == "error":
            break
    else:
        raise Skip(f"{_MANY} connections were welcomed: the bound is beyond what the kit tries")
    check((await _last(wire, trial))["code"] == "too_many", "another error than too_many")
    await observed.in_step()
    for each in trial.wires[1:]:
        each.say({"type": "bye"})
        await each.ends()
    await trial.client("observer", "later")


async def _last(refused: Any, trial: Trial) -> Any:
    # The first refusal was read to find the bound; ask for another one to look at.
    again = await trial.open("one-more")
    again.say(trial.target.hello(trial.name("one-more"), "observer"))
    return await again.fails("too_many")


@case(
    "HEL-15/unseen",
    "Connect; say hello with no version in common; look at states and leases",
    "Nobody sees that connection",
)
async def _(trial: Trial) -> None:
    watcher = await trial.client("observer", "watcher")
    await trial.open("silent")
    wire = await trial.open("odd")
    wire.say({**trial.target.hello(trial.name("odd"), "operator"), "versions": [60000]})
    await wire.fails("version")
    await watcher.in_step()
    check(not watcher.inbox, f"the watcher was told {list(watcher.inbox)}")


@case(
    "HEL-16/namesakes",
    "Connect twice with the same name, and have each acquire",
    "Both are welcomed; one gets the robot",
)
async def _(trial: Trial) -> None:
    first, second = await trial.open("first"), await trial.open("second")
    for wire in (first, second):
        await trial.target.welcomed(wire, trial.name("same"), "controller")
    await first.answered("acquire", "lease", robot=trial.robot)
    await second.refused("acquire", "leased", robot=trial.robot)


# --- versions ---------------------------------------------------------------------------------------------


async def _chosen(trial: Trial, versions: list[int]) -> None:
    wire = await trial.client("observer", versions=versions)
    welcome = wire.welcome
    best = max(set(versions) & set(welcome["versions"]), default=None)
    check(welcome["version"] == best, f"chose {welcome['version']} of {versions} and {welcome['versions']}")
    check(welcome["client_versions"] == versions, f"echoes {welcome['client_versions']}, not {versions}")


for _slug, _versions in {
    "one": [1],
    "all": None,
    "unknown": [1, 60000],
    "unordered": [65535, 1, 40000],
    "double": [1, 1, 1],
    "many": [1, *range(50000, 50015)],
}.items():

    @case(
        f"VER-{5 if _slug in ('unordered', 'double', 'unknown', 'many') else 2}/{_slug}",
        f"Say hello with the versions {_versions or 'that the server lists'}",
        "The highest in common is chosen, both lists are echoed as they were",
        also=("VER-2", "VER-3"),
    )
    async def _(trial: Trial, versions: list[int] | None = _versions) -> None:
        await _chosen(trial, versions or list(trial.facts.welcome["versions"]))


@case("VER-4/none", "Say hello with the version 60000 only", "A fatal version; the text names both lists")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    wire.say({**trial.target.hello(trial.name("future"), "controller"), "versions": [60000]})
    error = await wire.fails("version")
    missing = [v for v in ("60000", str(trial.facts.welcome["versions"][0])) if v not in error["text"]]
    check(not missing, f"the text does not name {missing}: {error['text']}")


@case("EVO-5/capabilities", "Say hello with capabilities that nobody knows", "A welcome as without them")
async def _(trial: Trial) -> None:
    wire = await trial.client("observer", capabilities=["telepathy", "x:y/z-1"])
    await wire.in_step()


@case(
    "EVO-4/unnamed",
    "Say hello without capabilities; describe, subscribe to all, hold, move, signal, stop and reset",
    "No message of a type, and no shape, outcome or condition, that version 1 does not have",
    also=("EVO-5",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder("operator")
    wire = holder.wire
    await wire.answered("describe", "description")
    await wire.answered("subscribe", "subscribed")
    await holder.decided([0.0] * holder.n)
    await wire.answered("signal", "signaled", name="kit/unnamed", value=[1.0])
    stop = await wire.answered("stop", "stopped", robot=trial.robot)
    await trial.rested()
    await trial.lifted(wire, stop["stop"])
    await wire.in_step()  # every message so far was held against the forms of version 1


@case(
    "EVO-7/hello",
    "Say hello with version 1 and keys of a later version",
    "A welcome in the form of version 1",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer", versions=[1, 2, 3], dialect={"of": ["later"]}, compression=None)
    check(wire.welcome["version"] in wire.welcome["versions"], "the version chosen is not listed")


@case(
    "EVO-8/two", "Connect one client for every version that the server lists", "Each is welcomed with its own"
)
async def _(trial: Trial) -> None:
    listed = trial.facts.welcome["versions"]
    if len(listed) < 2:
        raise Skip("the server speaks one version only")
    for version in listed:
        wire = await trial.client("observer", f"v{version}", versions=[version])
        check(wire.welcome["version"] == version, f"asked for {version}, got {wire.welcome['version']}")


# --- the end ----------------------------------------------------------------------------------------------


@case("CON-3/bye", "Send a ping and bye in one write", "The pong, then bye, then the end")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    wire.say({"type": "ping", "time": 1.0}, {"type": "bye", "reason": "done"})
    told = [m["type"] for m in await wire.ends()]
    check(told == ["pong", "bye"], f"expected pong and bye, got {told}")


@case("CON-4/bye-first", "Say bye instead of hello", "bye, and the end")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    wire.say({"type": "bye"})
    told = [m["type"] for m in await wire.ends()]
    check(told == ["bye"], f"expected bye, got {told}")


@case(
    "CON-5/after-bye",
    "Hold the robot; send bye and a stop in one write",
    "No stop: what comes after bye is not done",
    also=("LOS-1",),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    holder.wire.say({"type": "bye"}, {"type": "stop", "reason": "after bye"})
    await holder.wire.ends()
    await trial.freed()
    await trial.observer.ticks(trial.robot, 2)
    check(not trial.observer.stops(), "a stop after bye is in force")


@case(
    "CON-8/before-a-fault",
    "Send a stop and garbage in one write",
    "The stop is in force: what came before the fault counts",
    also=("CON-6",),
)
async def _(trial: Trial) -> None:
    wire = await trial.client()
    wire.write(pack({"type": "stop", "reason": "counts"}) + frame(b"\xc1"), "a stop, then garbage")
    await wire.fails("malformed")
    await trial.observer.until(lambda: bool(trial.observer.stops()), "the stop to be in force")


@case(
    "CON-9/neighbour",
    "Hold and move the robot while another connection sends garbage",
    "The holder notices nothing",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    await holder.moved()
    for payload in (b"\xc1", b"\x90", b"\x80\x80"):
        odd = await trial.open("odd")
        odd.write(frame(payload), "garbage")
        await odd.ends()
        await holder.moved()
