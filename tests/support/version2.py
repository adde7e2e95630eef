"""Second version of the protocol, only for tests; it differs in every way in which a version may.

A command contains increments for several ticks (``steps``), a jog moves one joint, a verdict contains
``done`` instead of an outcome and a blend, states have no counts, and a signal has no answer.
"""

from typing import Annotated, Literal

from pydantic import Field

from armgate.protocol import DIALECTS, Dialect, ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m


class Command(m.Message):
    type: Literal["command"] = "command"
    robot: m.Name
    fence: m.Count
    seq: m.Count
    tick: m.Count
    steps: Annotated[tuple[m.Increment, ...], Field(min_length=1, max_length=8)]


class Jog(m.Message):
    type: Literal["jog"] = "jog"
    robot: m.Name
    fence: m.Count
    seq: m.Count
    tick: m.Count
    joint: Annotated[int, Field(ge=0, lt=3)]
    by: m.Finite


class Verdict(m.Message):
    type: Literal["verdict"] = "verdict"
    robot: m.Name
    seq: m.Count
    done: bool
    text: m.Text = ""


class Entry(m.Part):
    robot: m.Name
    setpoint: m.Joints | None = None


class State(m.Message):
    type: Literal["state"] = "state"
    robot: m.Name
    tick: m.Count
    robots: tuple[Entry, ...]


def _inward(message):
    match message:
        case Command() if len(message.steps) > 1:
            text = "this server accepts one step at a time"
            raise RemoteProtocolError(ErrorCode.INVALID_MESSAGE, text, about="command", seq=message.seq)
        case Command():
            return _command(message, message.steps[0])
        case Jog():
            return _command(message, tuple(message.by if j == message.joint else 0.0 for j in range(3)))
    return message


def _command(message, dq):
    return m.Command(robot=message.robot, fence=message.fence, seq=message.seq, tick=message.tick, dq=dq)


def _outward(message):
    match message:
        case m.Verdict():
            text = message.reasons[0].text if message.reasons else ""
            done = message.outcome != "refused"
            return Verdict(robot=message.robot, seq=message.seq, done=done, text=text)
        case m.State():
            entries = tuple(Entry(robot=e.robot, setpoint=e.setpoint) for e in message.entries)
            return State(robot=message.robot, tick=message.tick, robots=entries)
        case m.Signaled():
            return None
    return message


_CLIENT = {**DIALECTS[0].client} | {"command": Command, "jog": Jog}
_SERVER = {key: model for key, model in DIALECTS[0].server.items() if key != "signaled"} | {
    "verdict": Verdict, "state": State,
}  # fmt: skip

SERVER_SIDE = Dialect(2, _CLIENT, _SERVER, _inward, _outward)
"""Dialect of version 2 for a program that uses version 1."""

CLIENT_SIDE = Dialect(2, _CLIENT, _SERVER)
"""Dialect of version 2 for a client that uses version 2."""

BOTH = (*DIALECTS, SERVER_SIDE)
