"""Stop and reset: checks before the gate, and announcements of the results to all clients.

The gate keeps the stops in force. A stop ends the leases of its robots, and an operator's reset makes them
available again once no stop is in force for them (`Leasing.stop`, `Leasing.resume`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from armgate import events
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world import to_protocol
from armgate.world.description import STOP_REPLACES
from armgate.world.gate_runner import GateRunner
from armgate.world.interfaces import EventLog, Peer


class Stopping:
    """Stops and resets of one cell.

    Args:
        robots: Names of the robots.
        gate: Keeps the stops in force.
        peers: Sessions by id.
        log: Receives stops and resets.
    """

    def __init__(
        self, robots: Sequence[str], gate: GateRunner, peers: Mapping[str, Peer], log: EventLog
    ) -> None:
        self._robots = tuple(robots)
        self._gate = gate
        self._peers = peers
        self._log = log
        self._resets_allowed = True

    @property
    def unstopped(self) -> bool:
        """True if there is a robot for which no stop is in force."""
        return any(not self._gate.stops(robot) for robot in self._robots)

    def refuse_resets(self) -> None:
        """Refuse every reset from now on: the daemon is ending."""
        self._resets_allowed = False

    def check_reset(self, peer: Peer, request: m.Reset) -> None:
        """Check a reset before the gate.

        Raises:
            RemoteProtocolError: ``shutting_down``; or ``unknown_stop``, if the stop was replaced by another
                one and the client supports replaced stops.
        """
        if not self._resets_allowed:
            text = "the daemon is ending: no stop is reset any more"
            raise RemoteProtocolError(ErrorCode.SHUTTING_DOWN, text, fatal=False, about="reset")
        if STOP_REPLACES in peer.client.capabilities and not self._in_force(request.stop):
            # It may have been replaced by a stop that this operator has not seen yet.
            raise _unknown_stop(request.stop)

    def announce_stop(self, stopped: events.Stopped, asker: Peer | None, request: m.Request | None) -> str:
        """Announce a stop to all clients; return the reason to send to clients that lose a lease."""
        reason = to_protocol.text(stopped.reason)
        fields: dict[str, Any] = {
            "stop": stopped.id,
            "robots": stopped.robots,
            "reason": reason,
            "by": stopped.by,
        }
        if stopped.replaces is not None:
            fields["replaces"] = stopped.replaces
        self._log.warning("stopped", **fields)
        for peer in tuple(self._peers.values()):
            peer.send(to_protocol.answer(m.Stopped, request if peer is asker else None, **fields))
        return to_protocol.text(f"stop {stopped.id} by {stopped.by}: {reason}")

    def announce_reset(self, reset: events.ResetAnswer, asker: Peer, request: m.Reset) -> None:
        """Announce a reset to all clients.

        Raises:
            RemoteProtocolError: ``unknown_stop`` or ``moving``: the gate has refused it.
        """
        if not reset.accepted:
            raise _NO_RESET[reset.reason](reset.stop)
        name = asker.client.name
        self._log.info("resumed", stop=reset.stop, by=name)
        in_force = reset.stop if reset.lifted is None else reset.lifted
        for peer in tuple(self._peers.values()):
            if peer is asker:
                more = {} if reset.lifted is None else {"lifted": reset.lifted}
                peer.send(to_protocol.answer(m.Resumed, request, stop=reset.stop, by=name, **more))
            else:
                peer.send(to_protocol.answer(m.Resumed, None, stop=in_force, by=name))

    def free(self) -> list[str]:
        """Return the robots for which no stop is in force."""
        return [robot for robot in self._robots if not self._gate.stops(robot)]

    def _in_force(self, stop: int) -> bool:
        return any(stop in self._gate.stops(robot) for robot in self._robots)


def _unknown_stop(stop: int) -> RemoteProtocolError:
    text = f"no stop {stop} is in force; the entries of the states name the stops in force"
    return RemoteProtocolError(ErrorCode.UNKNOWN_STOP, text, about="reset")


def _moving(stop: int) -> RemoteProtocolError:
    still = f"a robot of stop {stop} still moves, or has not ticked since its link was lost"
    return RemoteProtocolError(ErrorCode.MOVING, f"{still}; reset when it rests", about="reset")


_NO_RESET: dict[str, Callable[[int], RemoteProtocolError]] = {"unknown": _unknown_stop, "moving": _moving}
"""Errors by the reason for which the gate has refused a reset."""
