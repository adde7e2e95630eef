"""Hello, versions, and the end of a connection."""

from functools import partial
from typing import Any

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import frame, pack
from armgate.conformance.context import CaseContext

_HANDSHAKE = 15.0
"""Time in which a server must close the connection of a silent client, s; the kit does not know its limit."""

_MANY = 300
"""Number of connections that the kit opens at most to find the limit of the server."""


@case(
    "HEL-3/first",
    "Send hello and then describe at once after the welcome",
    "One welcome, before anything else",
)
async def welcome_is_the_first_message(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send(ctx.target.hello(ctx.name("first"), "controller"))
    first = await client.receive(lambda m: True, "welcome")
    check(first["type"] == "welcome", f"the first message was {first['type']}")
    await client.call("describe", "description")


@case(
    "HEL-17/packet",
    "Send hello and a ping in one write",
    "The welcome, then the pong",
    also=("HEL-3", "FRM-2"),
)
async def messages_after_hello_in_one_write_are_answered(ctx: CaseContext) -> None:
    client = await ctx.connect()
    ping = {"type": "ping", "id": 7, "time": 1.0}
    client.send(ctx.target.hello(ctx.name("first"), "controller"), ping)
    first = await client.receive(lambda m: True, "welcome")
    check(first["type"] == "welcome", f"the first message was {first['type']}")
    second = await client.answer_to(7)
    check(second["type"] == "pong", f"the ping was answered by {second}")


_FIRST_MESSAGES: dict[str, dict[str, Any]] = {
    "ping": {"time": 1.0},
    "describe": {},
    "acquire": {"robot": "R"},
    "command": {"robot": "R", "fence": 1, "seq": 1, "tick": 1, "dq": [0.0]},
    "stop": {"reason": "before hello"},
    "subscribe": {},
    "reset": {"stop": 1},
}


async def message_before_hello_is_fatal(ctx: CaseContext, kind: str, fields: dict[str, Any]) -> None:
    client = await ctx.connect()
    client.send_bytes(pack({"type": kind, **fields}), f"{kind} before hello")
    await client.expect_fatal("unexpected")
    await ctx.observer.ticks(ctx.robot, 2)
    check(not ctx.observer.stops(), "a stop before hello is in force")
    check(ctx.entry()["holder"] is None, "an acquire before hello was granted")


for _kind, _fields in _FIRST_MESSAGES.items():
    case(
        f"HEL-4/{_kind}",
        f"Begin with {_kind} instead of hello",
        "A fatal error unexpected; no effect",
        also=("HEL-15",),
    )(partial(message_before_hello_is_fatal, kind=_kind, fields=_fields))


@case(
    "HEL-6/again",
    "Send hello a second time, while holding the robot",
    "A fatal error unexpected; the robot is free",
    also=("CON-2",),
)
async def second_hello_of_a_holder_is_fatal(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    holder.connection.send(ctx.target.hello(ctx.name("again"), "operator"))
    await holder.connection.expect_fatal("unexpected")
    await ctx.wait_free()


@case(
    "CON-2/unexpected",
    "Send hello twice in one write",
    "A welcome, then a fatal error unexpected",
    also=("CON-1",),
)
async def second_hello_in_one_write_is_fatal_after_the_welcome(ctx: CaseContext) -> None:
    client = await ctx.connect()
    hello = ctx.target.hello(ctx.name("twice"), "observer")
    client.send(hello, hello)
    found = await client.receive_until_closed()
    kinds = [(m["type"], m.get("code")) for m in found]
    check(
        kinds == [("welcome", None), ("error", "unexpected")], f"expected welcome and unexpected, got {kinds}"
    )


@case(
    "HEL-7/role", "Send hello in each role", "The welcome grants the requested role, if the token allows it"
)
async def welcome_grants_the_requested_role(ctx: CaseContext) -> None:
    for role in ("observer", "controller", "operator"):
        client = await ctx.client(role, role)
        check(
            client.welcome["role"] == role, f"requested {role}, the welcome grants {client.welcome['role']}"
        )
        check(client.welcome["name"] == ctx.name(role), f"the welcome's name is {client.welcome['name']}")


@case("HEL-8/default", "Send hello without a role, then acquire", "The session has the role controller")
async def role_defaults_to_controller(ctx: CaseContext) -> None:
    client = await ctx.connect()
    hello = ctx.target.hello(ctx.name("bare"), "controller")
    del hello["role"]
    client.send(hello)
    welcome = await client.expect("welcome")
    check(welcome["role"] == "controller", f"the role is {welcome['role']}")
    await client.call("acquire", "lease", robot=ctx.robot)


@case(
    "HEL-9/sessions",
    "Connect eight times",
    "Every session has a unique id; start is the same",
    also=("HEL-10",),
)
async def sessions_have_unique_ids_and_the_same_start(ctx: CaseContext) -> None:
    wires = [await ctx.client("observer", f"c{i}") for i in range(8)]
    sessions = {client.welcome["session"] for client in wires}
    check(len(sessions) == 8, f"8 sessions have the ids {sorted(sessions)}")
    starts = {client.welcome["start"] for client in wires}
    check(starts == {ctx.server.welcome["start"]}, f"start differs: {starts}")


@case("HEL-11/anew", "Start another server of the same kind and send it hello", "It has another start id")
async def second_server_has_another_start_id(ctx: CaseContext) -> None:
    async with ctx.second_server() as target:
        client = await ctx.client_of(target, ctx.name("anew"), "observer")
        check(client.welcome["start"] != ctx.server.welcome["start"], "two servers have the same start id")


@case("HEL-12/limits", "Check the limits in welcome", "inbound 65536, outbound 1048576, the others positive")
async def welcome_states_the_limits(ctx: CaseContext) -> None:
    limits = (await ctx.client("observer")).welcome["limits"]
    check(limits["inbound"] == 65536, f"inbound is {limits['inbound']}")
    check(limits["outbound"] == 1048576, f"outbound is {limits['outbound']}")
    check(limits["lease_ttl"] > 0 and limits["signal_rate"] > 0, "lease_ttl and signal_rate must be positive")


@case("HEL-13/silent", "Connect and send nothing", "A fatal error handshake_timeout within 15 s")
async def silent_connection_times_out(ctx: CaseContext) -> None:
    client = await ctx.connect()
    await client.expect_fatal("handshake_timeout", within=_HANDSHAKE + ctx.target.timeout)


@case("HEL-13/drip", "Connect and send 3 bytes of a frame", "A fatal error handshake_timeout within 15 s")
async def incomplete_hello_times_out(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send_bytes(b"\x00\x00\x00", "3 bytes of a length")
    await client.expect_fatal("handshake_timeout", within=_HANDSHAKE + ctx.target.timeout)


@case(
    "HEL-14/full",
    f"Open connections until one is refused, {_MANY} at most; then close them and connect again",
    "One connection more than the limit gets an error too_many; other clients are unaffected; closed connections do not count",
    also=("SEC-11", "CON-9"),
)
async def connection_beyond_the_limit_is_refused(ctx: CaseContext) -> None:
    observed = await ctx.client("observer", "watcher")
    for number in range(_MANY):
        client = await ctx.connect(f"c{number}")
        client.send(ctx.target.hello(ctx.name(f"c{number}"), "observer"))
        if (await client.expect("welcome", "error"))["type"] == "error":
            break
    else:
        raise Skip(f"{_MANY} connections were welcomed: the limit is above what the kit tests")
    check((await _next_refusal(ctx))["code"] == "too_many", "another error than too_many")
    await observed.sync()
    for each in ctx.connections[1:]:
        each.send({"type": "bye"})
        await each.receive_until_closed()
    await ctx.client("observer", "later")


async def _next_refusal(ctx: CaseContext) -> Any:
    # The first refusal was consumed to find the limit, so provoke another one.
    again = await ctx.connect("one-more")
    again.send(ctx.target.hello(ctx.name("one-more"), "observer"))
    return await again.expect_fatal("too_many")


@case(
    "HEL-15/unseen",
    "Connect; send hello without a common version; check what another client receives",
    "No other client receives anything about that connection",
)
async def connection_without_welcome_is_invisible(ctx: CaseContext) -> None:
    watcher = await ctx.client("observer", "watcher")
    await ctx.connect("silent")
    client = await ctx.connect("odd")
    client.send({**ctx.target.hello(ctx.name("odd"), "operator"), "versions": [60000]})
    await client.expect_fatal("version")
    await watcher.sync()
    check(not watcher.inbox, f"the watcher received {list(watcher.inbox)}")


@case(
    "HEL-16/namesakes",
    "Connect twice with the same name, and acquire the robot in both sessions",
    "Both are welcomed; one acquires the robot",
)
async def clients_with_the_same_name_are_both_welcomed(ctx: CaseContext) -> None:
    first, second = await ctx.connect("first"), await ctx.connect("second")
    for client in (first, second):
        await ctx.target.handshake(client, ctx.name("same"), "controller")
    await first.call("acquire", "lease", robot=ctx.robot)
    await second.expect_refusal("acquire", "leased", robot=ctx.robot)


# --- versions ---------------------------------------------------------------------------------------------


async def _chosen(ctx: CaseContext, versions: list[int]) -> None:
    client = await ctx.client("observer", versions=versions)
    welcome = client.welcome
    best = max(set(versions) & set(welcome["versions"]), default=None)
    check(welcome["version"] == best, f"chose {welcome['version']} of {versions} and {welcome['versions']}")
    check(welcome["client_versions"] == versions, f"echoes {welcome['client_versions']}, not {versions}")


async def highest_common_version_is_chosen(ctx: CaseContext, versions: list[int] | None) -> None:
    await _chosen(ctx, versions or list(ctx.server.welcome["versions"]))


for _slug, _versions in {
    "one": [1],
    "all": None,
    "unknown": [1, 60000],
    "unordered": [65535, 1, 40000],
    "double": [1, 1, 1],
    "many": [1, *range(50000, 50015)],
}.items():
    case(
        f"VER-{5 if _slug in ('unordered', 'double', 'unknown', 'many') else 2}/{_slug}",
        f"Send hello with the versions {_versions or 'that the server lists'}",
        "The highest common version is chosen; both lists are returned unchanged",
        also=("VER-2", "VER-3"),
    )(partial(highest_common_version_is_chosen, versions=_versions))


@case(
    "VER-4/none", "Send hello with the version 60000 only", "A fatal error version; the text names both lists"
)
async def hello_without_a_common_version_is_fatal(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send({**ctx.target.hello(ctx.name("future"), "controller"), "versions": [60000]})
    error = await client.expect_fatal("version")
    missing = [v for v in ("60000", str(ctx.server.welcome["versions"][0])) if v not in error["text"]]
    check(not missing, f"the text does not name {missing}: {error['text']}")


@case("EVO-5/capabilities", "Send hello with unknown capabilities", "A welcome as without them")
async def unknown_capabilities_are_ignored(ctx: CaseContext) -> None:
    client = await ctx.client("observer", capabilities=["telepathy", "x:y/z-1"])
    await client.sync()


@case(
    "EVO-4/unnamed",
    "Send hello without capabilities; describe, subscribe to all, hold, move, signal, stop and reset",
    "All types of messages, shapes, outcomes and link states that are received belong to version 1",
    also=("EVO-5",),
)
async def client_without_capabilities_gets_version_1_only(ctx: CaseContext) -> None:
    holder = await ctx.holder("operator")
    client = holder.connection
    await client.call("describe", "description")
    await client.call("subscribe", "subscribed")
    await holder.command([0.0] * holder.n)
    await client.call("signal", "signaled", name="kit/unnamed", value=[1.0])
    stop = await client.call("stop", "stopped", robot=ctx.robot)
    await ctx.wait_at_rest()
    await ctx.reset_stop(client, stop["stop"])
    await client.sync()  # every message so far was validated against the schema of version 1


@case(
    "EVO-7/hello",
    "Send hello with version 1 and keys of a later version",
    "A welcome in the form of version 1",
)
async def hello_with_keys_of_a_later_version_is_welcomed(ctx: CaseContext) -> None:
    client = await ctx.client("observer", versions=[1, 2, 3], dialect={"of": ["later"]}, compression=None)
    check(client.welcome["version"] in client.welcome["versions"], "the chosen version is not listed")


@case(
    "EVO-8/two",
    "Connect one client for every version that the server lists",
    "Each is welcomed with its version",
)
async def every_listed_version_is_supported(ctx: CaseContext) -> None:
    listed = ctx.server.welcome["versions"]
    if len(listed) < 2:
        raise Skip("the server supports only one version")
    for version in listed:
        client = await ctx.client("observer", f"v{version}", versions=[version])
        check(client.welcome["version"] == version, f"requested {version}, got {client.welcome['version']}")


# --- end of a connection ----------------------------------------------------------------------------------------------


@case("CON-3/bye", "Send a ping and bye in one write", "The pong, then bye, then the end")
async def bye_is_answered_after_earlier_messages(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send({"type": "ping", "time": 1.0}, {"type": "bye", "reason": "done"})
    kinds = [m["type"] for m in await client.receive_until_closed()]
    check(kinds == ["pong", "bye"], f"expected pong and bye, got {kinds}")


@case("CON-4/bye-first", "Send bye instead of hello", "bye, and the end")
async def bye_instead_of_hello_is_answered(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send({"type": "bye"})
    kinds = [m["type"] for m in await client.receive_until_closed()]
    check(kinds == ["bye"], f"expected bye, got {kinds}")


@case(
    "CON-5/after-bye",
    "Hold the robot; send bye and a stop in one write",
    "No stop: messages after bye are ignored",
    also=("LOS-1",),
)
async def messages_after_bye_are_ignored(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    holder.connection.send({"type": "bye"}, {"type": "stop", "reason": "after bye"})
    await holder.connection.receive_until_closed()
    await ctx.wait_free()
    await ctx.observer.ticks(ctx.robot, 2)
    check(not ctx.observer.stops(), "a stop after bye is in force")


@case(
    "CON-8/before-a-fault",
    "Send a stop and garbage in one write",
    "The stop is in force: messages before the fault are processed",
    also=("CON-6",),
)
async def messages_before_a_fatal_fault_are_processed(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send_bytes(pack({"type": "stop", "reason": "counts"}) + frame(b"\xc1"), "a stop, then garbage")
    await client.expect_fatal("malformed")
    await ctx.observer.until(lambda: bool(ctx.observer.stops()), "the stop to be in force")


@case(
    "CON-9/neighbour",
    "Hold and move the robot while another connection sends garbage",
    "The holder is unaffected",
)
async def faulty_connection_leaves_others_undisturbed(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    await holder.move()
    for payload in (b"\xc1", b"\x90", b"\x80\x80"):
        odd = await ctx.connect("odd")
        odd.send_bytes(frame(payload), "garbage")
        await odd.receive_until_closed()
        await holder.move()
