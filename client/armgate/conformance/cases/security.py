"""Tokens and TLS."""

import ssl

from armgate.conformance.case import Skip, case, check
from armgate.conformance.command_log import CommandLog
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext
from armgate.conformance.target import Target

_WRONG = "armgate_" + "A" * 43
_GUESSES = 60
"""Number of wrong tokens after which a right one must still be accepted."""


@case("SEC-2/none", "Send hello without a token", "A fatal error unauthorized", also=("HEL-15",))
async def hello_without_a_token_is_unauthorized(ctx: CaseContext) -> None:
    client = await ctx.connect()
    hello = ctx.target.hello(ctx.name("none"), "observer")
    del hello["token"]
    client.send(hello)
    await client.expect_fatal("unauthorized")


@case(
    "SEC-2/wrong",
    "Send hello with a wrong token of the right form",
    "A fatal error unauthorized, whose text does not repeat the token",
    also=("SEC-7", "ERR-8"),
)
async def wrong_token_is_unauthorized_and_not_repeated(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send({**ctx.target.hello(ctx.name("wrong"), "observer"), "token": _WRONG})
    error = await client.expect_fatal("unauthorized")
    check("AAAA" not in error["text"], "the error repeats the token")


@case(
    "SEC-3/above",
    "With a token of a lower role, request the role operator",
    "A fatal error unauthorized, with the text for a wrong token",
)
async def role_above_the_token_is_unauthorized(ctx: CaseContext) -> None:
    lower = ctx.target.tokens.get("observer") or ctx.target.tokens.get("controller")
    if lower is None:
        raise Skip("--token-file has no token of a lower role")
    client, wrong = await ctx.connect("above"), await ctx.connect("wrong")
    client.send({**ctx.target.hello(ctx.name("above"), "operator"), "token": lower})
    wrong.send({**ctx.target.hello(ctx.name("wrong"), "operator"), "token": _WRONG})
    first, second = await client.expect_fatal("unauthorized"), await wrong.expect_fatal("unauthorized")
    check(first["text"] == second["text"], "the texts for a wrong role and a wrong token differ")


@case(
    "SEC-4/below",
    "With a token, request its role and those below",
    "A welcome each time, with the requested role",
)
async def roles_up_to_that_of_the_token_are_granted(ctx: CaseContext) -> None:
    ranks = ("observer", "controller", "operator")
    for owner, token in ctx.target.tokens.items():
        if owner not in ranks:
            continue
        for role in ranks[: ranks.index(owner) + 1]:
            client = await ctx.connect(role)
            client.send({**ctx.target.hello(ctx.name(f"{owner}-{role}"), role), "token": token})
            await client.expect("welcome", role=role)


@case(
    "SEC-5/robots",
    "With a token that allows other robots only, acquire this one",
    "An error forbidden, not fatal",
)
async def token_for_other_robots_cannot_acquire(ctx: CaseContext) -> None:
    token = ctx.target.tokens.get("elsewhere")
    if token is None:
        raise Skip("--token-file has no token named elsewhere")
    client = await ctx.connect()
    client.send({**ctx.target.hello(ctx.name("elsewhere"), "controller"), "token": token})
    await client.expect("welcome")
    await client.expect_refusal("acquire", "forbidden", robot=ctx.robot)


@case(
    "SEC-6/ignored", "On a server without tokens, send hello with a token", "A welcome in the requested role"
)
async def token_without_token_file_is_ignored(ctx: CaseContext) -> None:
    if ctx.target.token is not None:
        raise Skip("the server has tokens")
    client = await ctx.client("operator", token=_WRONG)
    check(client.welcome["role"] == "operator", f"the role is {client.welcome['role']}")


@case(
    "SEC-14/guesses",
    f"On a second server, send {_GUESSES} wrong tokens, one after the other, then a right one",
    "Each wrong token is refused by unauthorized, and the right one is welcomed",
)
async def wrong_tokens_do_not_lock_out_the_right_one(ctx: CaseContext) -> None:
    async with ctx.second_server() as target:
        for number in range(_GUESSES):
            await _send_wrong_token(ctx, target, _WRONG, f"guess{number}")
        owner = await ctx.connect_to(target, "owner")
        owner.send({**target.hello(ctx.name("owner"), "observer"), "token": str(target.token)})
        await owner.expect("welcome")


async def _send_wrong_token(ctx: CaseContext, target: Target, token: str, name: str) -> None:
    """Send a token that the server must reject."""
    client = await ctx.connect_to(target, name)
    client.send({**target.hello(ctx.name(name), "observer"), "token": token})
    await client.expect_fatal("unauthorized")


def _require_sessions(ctx: CaseContext) -> None:
    if "sessions" not in ctx.server.welcome.get("capabilities", ()):
        raise Skip("the server does not announce the capability sessions")


@case(
    "SEC-15/listed",
    "As operator, request the sessions while a client holds the robot",
    "A session_list with both sessions, in order, and the robot in the entry of its holder",
    also=("SEC-17",),
)
async def operator_can_list_the_sessions(ctx: CaseContext) -> None:
    _require_sessions(ctx)
    holder = await ctx.holder()
    client = await ctx.operator()
    listed = (await client.call("sessions", "session_list"))["sessions"]
    assert isinstance(listed, tuple | list)
    found = {one["session"]: one for one in listed}
    check(len(found) == len(listed), "a session is listed twice")
    own, other = (found.get(each.welcome["session"]) for each in (client, holder.connection))
    check(own is not None and own["role"] == "operator", "the operator is not listed")
    check(other is not None and ctx.robot in other["robots"], "the holder is not listed with its robot")
    places = [one["session"] for one in listed]
    first, second = holder.connection.welcome["session"], client.welcome["session"]
    check(places.index(first) < places.index(second), "the sessions are not in the order of their connection")
    await holder.connection.expect_refusal("sessions", "forbidden")
    await holder.connection.expect_refusal("kick", "forbidden", session=client.welcome["session"])


@case(
    "SEC-16/kicked",
    "As operator, end the session of a client that holds the robot; end it again",
    "kicked; a fatal error kicked for the client; its robot is free; the second time an error unknown_session",
    also=("SEC-17",),
)
async def operator_can_end_a_session(ctx: CaseContext) -> None:
    _require_sessions(ctx)
    holder = await ctx.holder()
    client = await ctx.operator()
    session = holder.connection.welcome["session"]
    await client.call("kick", "kicked", session=session, reason="tested by the kit")
    await holder.connection.expect_fatal("kicked")
    await ctx.wait_free()
    await client.expect_refusal("kick", "unknown_session", session=session)


@case(
    "SEC-10/plain",
    "Connect and send hello without TLS",
    "No welcome: the server sends nothing of this protocol outside TLS",
)
async def server_with_tls_refuses_plain_connections(ctx: CaseContext) -> None:
    client = Connection("plain", ctx.log, CommandLog(), ctx.target.timeout)
    await ctx.target.connect(lambda: client, plain=True)
    ctx.connections.append(client)
    client.send(ctx.target.hello(ctx.name("plain"), "observer"))
    await client.receive_until_closed(within=30.0)
    client.violations.clear()  # a TLS alert is not a frame, and need not be one
    check(not client.welcome, "welcomed without TLS")


@case("SEC-10/old", "Offer TLS 1.1 only", "The handshake fails")
async def outdated_tls_is_rejected(ctx: CaseContext) -> None:
    old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    old.check_hostname, old.verify_mode = False, ssl.CERT_NONE
    try:
        old.set_ciphers("ALL:@SECLEVEL=0")
        old.minimum_version = ssl.TLSVersion.TLSv1_1
        old.maximum_version = ssl.TLSVersion.TLSv1_1
    except (ssl.SSLError, ValueError) as error:
        raise Skip(f"this machine's TLS library has no TLS 1.1: {error}") from error
    client = Connection("old", ctx.log, CommandLog(), ctx.target.timeout)
    try:
        await ctx.target.connect(lambda: client, tls=old)
    except (OSError, ssl.SSLError):
        return
    ctx.connections.append(client)
    check(False, "a handshake with TLS 1.1 succeeded")
