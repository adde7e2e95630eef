"""The SDK: what a controller, an observer or an operator needs to work with a cell.

::

    with connect("127.0.0.1:7411", name="wave") as cell, cell.acquire("FR") as robot:
        for tick in robot.ticks():
            verdict = robot.send([0.001] * len(tick.setpoint))

``armgate.client.blocking`` (whose ``connect`` this is) and ``armgate.client.aio`` have the same names. The
exceptions are told in ``armgate.client.errors``; messages that a caller gets are re-exported here. Nothing
reconnects or acquires again by itself.
"""

from armgate.client.address import parse_address
from armgate.client.blocking import Cell, Robot, connect
from armgate.client.errors import (
    BadArgument,
    ClientError,
    ConnectionLost,
    LeaseLost,
    Lost,
    Refused,
    Rejected,
    RobotStopped,
    TimedOut,
)
from armgate.client.secret import read_token
from armgate.client.tick import Tick
from armgate.client.tls import Tls, tls_context
from armgate.protocol.messages import (
    Body,
    Description,
    Entry,
    Exact,
    Joint,
    Lease,
    Nearest,
    Reason,
    RobotDescription,
    Role,
    SessionInfo,
    Shape,
    SignalValue,
    State,
    Verdict,
    Welcome,
)

__all__ = [
    "BadArgument",
    "Body",
    "Cell",
    "ClientError",
    "ConnectionLost",
    "Description",
    "Entry",
    "Exact",
    "Joint",
    "Lease",
    "LeaseLost",
    "Lost",
    "Nearest",
    "Reason",
    "Refused",
    "Rejected",
    "Robot",
    "RobotDescription",
    "RobotStopped",
    "Role",
    "SessionInfo",
    "Shape",
    "SignalValue",
    "State",
    "Tick",
    "TimedOut",
    "Tls",
    "Verdict",
    "Welcome",
    "connect",
    "parse_address",
    "read_token",
    "tls_context",
]
