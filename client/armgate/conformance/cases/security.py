"""Tokens and TLS."""

import ssl

from armgate.conformance.case import case
from armgate.conformance.ledger import Ledger
from armgate.conformance.target import Target
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check
from armgate.conformance.wire import Wire

_WRONG = "armgate_" + "A" * 43
_GUESSES = 60
"""Wrong tokens after which a right one must still be accepted."""


@case("SEC-2/none", "Say hello without a token", "A fatal unauthorized", also=("HEL-15",))
async def _(trial: Trial) -> None:
    wire = await trial.open()
    hello = trial.target.hello(trial.name("none"), "observer")
    del hello["token"]
    wire.say(hello)
    await wire.fails("unauthorized")


@case(
    "SEC-2/wrong",
    "Say hello with a token that looks right and is wrong",
    "A fatal unauthorized whose text does not repeat it",
    also=("SEC-7", "ERR-8"),
)
async def _(trial: Trial) -> None:
    wire = await trial.open()
    wire.say({**trial.target.hello(trial.name("wrong"), "observer"), "token": _WRONG})
    error = await wire.fails("unauthorized")
    check("AAAA" not in error["text"], "the error repeats the token")


@case(
    "SEC-3/above",
    "With a token of a lower role, ask to be operator",
    "A fatal unauthorized, with the text for a wrong token",
)
async def _(trial: Trial) -> None:
    lower = trial.target.tokens.get("observer") or trial.target.tokens.get("controller")
    if lower is None:
        raise Skip("--token-file has no token of a lower role")
    wire, wrong = await trial.open("above"), await trial.open("wrong")
    wire.say({**trial.target.hello(trial.name("above"), "operator"), "token": lower})
    wrong.say({**trial.target.hello(trial.name("wrong"), "operator"), "token": _WRONG})
    first, second = await wire.fails("unauthorized"), await wrong.fails("unauthorized")
    check(first["text"] == second["text"], "the text tells a wrong role from a wrong token")


@case(
    "SEC-4/below",
    "With a token, ask for its role and those below",
    "A welcome each time, with the role asked for",
)
async def _(trial: Trial) -> None:
    ranks = ("observer", "controller", "operator")
    for owner, token in trial.target.tokens.items():
        if owner not in ranks:
            continue
        for role in ranks[: ranks.index(owner) + 1]:
            wire = await trial.open(role)
            wire.say({**trial.target.hello(trial.name(f"{owner}-{role}"), role), "token": token})
            await wire.expect("welcome", role=role)


@case("SEC-5/robots", "With a token that allows other robots only, acquire this one", "forbidden, not fatal")
async def _(trial: Trial) -> None:
    token = trial.target.tokens.get("elsewhere")
    if token is None:
        raise Skip("--token-file has no token named elsewhere")
    wire = await trial.open()
    wire.say({**trial.target.hello(trial.name("elsewhere"), "controller"), "token": token})
    await wire.expect("welcome")
    await wire.refused("acquire", "forbidden", robot=trial.robot)


@case("SEC-6/ignored", "Without tokens on the server, say hello with one", "A welcome in the role asked for")
async def _(trial: Trial) -> None:
    if trial.target.token is not None:
        raise Skip("the server has tokens")
    wire = await trial.client("operator", token=_WRONG)
    check(wire.welcome["role"] == "operator", f"the role is {wire.welcome['role']}")


@case(
    "SEC-14/guesses",
    f"On a server of its own, bring {_GUESSES} wrong tokens, one after the other, then a right one",
    "Each wrong one is refused by unauthorized, and the right one is welcomed",
)
async def _(trial: Trial) -> None:
    async with trial.anew() as target:
        for number in range(_GUESSES):
            await _refused(trial, target, _WRONG, f"guess{number}")
        owner = await trial.call(target, "owner")
        owner.say({**target.hello(trial.name("owner"), "observer"), "token": str(target.token)})
        await owner.expect("welcome")


async def _refused(trial: Trial, target: Target, token: str, name: str) -> None:
    """Bring a token that a server must not take."""
    wire = await trial.call(target, name)
    wire.say({**target.hello(trial.name(name), "observer"), "token": token})
    await wire.fails("unauthorized")


def _lists_sessions(trial: Trial) -> None:
    if "sessions" not in trial.facts.welcome.get("capabilities", ()):
        raise Skip("the server does not name the capability sessions")


@case(
    "SEC-15/listed",
    "As operator, ask for the sessions while a client holds the robot",
    "A session_list with both, in order, and the robot at its holder",
    also=("SEC-17",),
)
async def _(trial: Trial) -> None:
    _lists_sessions(trial)
    holder = await trial.holder()
    wire = await trial.operator()
    listed = (await wire.answered("sessions", "session_list"))["sessions"]
    assert isinstance(listed, tuple | list)
    found = {one["session"]: one for one in listed}
    check(len(found) == len(listed), "a session is listed twice")
    own, other = (found.get(each.welcome["session"]) for each in (wire, holder.wire))
    check(own is not None and own["role"] == "operator", "the operator is not listed")
    check(other is not None and trial.robot in other["robots"], "the holder is not listed with its robot")
    places = [one["session"] for one in listed]
    first, second = holder.wire.welcome["session"], wire.welcome["session"]
    check(places.index(first) < places.index(second), "the order is another one")
    await holder.wire.refused("sessions", "forbidden")
    await holder.wire.refused("kick", "forbidden", session=wire.welcome["session"])


@case(
    "SEC-16/kicked",
    "As operator, end the session of a client that holds the robot; end it again",
    "kicked; a fatal kicked for the client; its robot is free; then unknown_session",
    also=("SEC-17",),
)
async def _(trial: Trial) -> None:
    _lists_sessions(trial)
    holder = await trial.holder()
    wire = await trial.operator()
    session = holder.wire.welcome["session"]
    await wire.answered("kick", "kicked", session=session, reason="tried by the kit")
    await holder.wire.fails("kicked")
    await trial.freed()
    await wire.refused("kick", "unknown_session", session=session)


@case(
    "SEC-10/plain",
    "Speak the protocol without TLS",
    "No welcome: nothing of this protocol is said outside TLS",
)
async def _(trial: Trial) -> None:
    wire = Wire("plain", trial.log, Ledger(), trial.target.patience)
    await trial.target.connect(lambda: wire, plain=True)
    trial.wires.append(wire)
    wire.say(trial.target.hello(trial.name("plain"), "observer"))
    await wire.ends(within=30.0)
    wire.faults.clear()  # (a TLS alert is no frame, and need not be one)
    check(not wire.welcome, "welcomed without TLS")


@case("SEC-10/old", "Offer TLS 1.1 only", "The handshake fails")
async def _(trial: Trial) -> None:
    old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    old.check_hostname, old.verify_mode = False, ssl.CERT_NONE
    try:
        old.set_ciphers("ALL:@SECLEVEL=0")
        old.minimum_version = ssl.TLSVersion.TLSv1_1
        old.maximum_version = ssl.TLSVersion.TLSv1_1
    except (ssl.SSLError, ValueError) as error:
        raise Skip(f"this machine's TLS library has no TLS 1.1: {error}") from error
    wire = Wire("old", trial.log, Ledger(), trial.target.patience)
    try:
        await trial.target.connect(lambda: wire, tls=old)
    except (OSError, ssl.SSLError):
        return
    trial.wires.append(wire)
    check(False, "a handshake with TLS 1.1 succeeded")
