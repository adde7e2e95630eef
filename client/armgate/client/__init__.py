"""SDK for controllers, observers and operators of a cell.

::

    with connect("127.0.0.1:7411", name="wave") as cell, cell.acquire("FR") as robot:
        for tick in robot.ticks():
            verdict = robot.send([0.001] * len(tick.setpoint))

``connect`` is the function of ``armgate.client.blocking``; ``armgate.client.aio`` has the same names for
asyncio. ``armgate.client.errors`` documents the exceptions. Messages that calls return are re-exported here.
The SDK neither reconnects nor acquires a robot again by itself.
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
from armgate.client.security import Tls, read_token, tls_context
from armgate.client.tick import Tick
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
