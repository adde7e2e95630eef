"""Servers with one deviation each: the daemon with one behaviour changed. The case for it must fail."""

import hashlib
import math
import re
from dataclasses import replace
from itertools import count
from typing import Literal

import pytest

from armgate import events
from armgate.conformance.case import Outcome
from armgate.daemon.lifecycle import daemon as daemon_module
from armgate.daemon.sessions.peer_socket import TcpPeerSocket
from armgate.daemon.sessions.session import Session
from armgate.daemon.sessions.writing import WriterBatch
from armgate.gate import Gate, command_checks
from armgate.gate.stops import Stops
from armgate.protocol import Leases, RemoteProtocolError, codec, connection
from armgate.protocol import messages as m
from armgate.world import assets, to_protocol
from armgate.world import description as description_module
from armgate.world.barrier import Barrier
from armgate.world.core import Core
from armgate.world.interfaces import Client
from armgate.world.lease_changes import Leasing
from armgate.world.rights import RIGHTS
from armgate.world.signals import Signals
from armgate.world.states import Subscription
from armgate.world.stopping import Stopping
from armgate.world.welcome import Greeter

CASE_TIMEOUT = 2.0
LOCKSTEP = ("conformance.yaml", "conformance-lockstep.yaml")


def around(patch, owner, name, make):
    """Replace a method by a wrapper of it."""
    patch.setattr(owner, name, make(getattr(owner, name)))


def without(patch, check):
    """Remove one of the checks before the gate's decision."""
    patch.setattr(command_checks, "_CHECKS", tuple(c for c in command_checks._CHECKS if c is not check))


def two_verdicts(patch):
    def report(self, output, asker, request):
        right(self, output, asker, request)
        if isinstance(output, events.Verdict):
            right(self, output, asker, request)

    right = Core._report
    patch.setattr(Core, "_report", report)


def no_verdict_for_refused_commands(patch):
    def report(self, output, asker, request):
        if not (isinstance(output, events.Verdict) and output.outcome is events.Outcome.REFUSED):
            right(self, output, asker, request)

    right = Core._report
    patch.setattr(Core, "_report", report)


def verdicts_out_of_order(patch):
    held = []

    def report(self, output, asker, request):
        if isinstance(output, events.Verdict):
            held.append((output, asker, request))
            if len(held) == 2:
                for one in reversed(held):
                    right(self, *one)
                held.clear()
        else:
            right(self, output, asker, request)

    right = Core._report
    patch.setattr(Core, "_report", report)


def verdicts_to_all_sessions(patch):
    def report(self, output, asker, request):
        if isinstance(output, events.Verdict):
            for peer in self.peers.values():
                peer.send(to_protocol.verdict(output))
        else:
            right(self, output, asker, request)

    right = Core._report
    patch.setattr(Core, "_report", report)


def moves_by_refused_commands(patch):
    refusal = events.Reason(events.Cause.CLEARANCE, "no", pair=("a", "b"))

    def verdict(output):
        if output.outcome is events.Outcome.ADMITTED and any(output.dq):
            output = replace(output, outcome=events.Outcome.REFUSED, beta=0.0, reasons=(refusal,))
        return right(output)

    right = to_protocol.verdict
    patch.setattr(to_protocol, "verdict", verdict)


def reports_another_increment(patch):
    right = to_protocol.verdict
    patch.setattr(
        to_protocol, "verdict", lambda output: right(replace(output, dq=tuple(0.5 * x for x in output.dq)))
    )


def old_ticks_accepted(patch):
    without(patch, command_checks._age)


def two_commands_a_tick(patch):
    without(patch, command_checks._one_per_tick)


def cleaned(clean):
    """Return a change that repairs increments instead of refusing them."""

    def change(patch):
        def step(self, event):
            if isinstance(event, events.Command):
                n = self._of(event.robot).robot.model.n
                event = replace(event, dq=clean(event.dq, n))
            return right(self, event)

        right = Gate.step
        patch.setattr(Gate, "step", step)

    return change


def checks_in_another_order(patch):
    patch.setattr(command_checks, "_CHECKS", tuple(reversed(command_checks._CHECKS)))


def refusals_take_the_slot(patch):
    def command(self, event):
        outputs = right(self, event)
        if outputs[0].outcome is events.Outcome.REFUSED:
            state = self._of(event.robot)
            state.slot = state.tick + 1
        return outputs

    right = Gate._command
    patch.setattr(Gate, "_command", command)


def with_the_fence_in_force(gate, event):
    fence = gate._of(event.robot).fence
    return event if fence is None else replace(event, fence=fence, holder=True)


def fence_ignored(patch):
    around(
        patch, Gate, "_command",
        lambda right: lambda self, event: right(self, with_the_fence_in_force(self, event)),
    )  # fmt: skip


def any_fence_of_the_holder(patch):
    around(
        patch, Gate, "_command",
        lambda right: lambda self, event: right(
            self, with_the_fence_in_force(self, event) if event.holder else event
        ),
    )  # fmt: skip


def acquiring(**changed):
    """Return a change that acquires leases with other arguments."""

    def change(patch):
        around(
            patch, Leases, "acquire",
            lambda right: lambda self, robot, session, role, **more: right(
                self, robot, session, changed.get("role", role),
                **more | {k: v for k, v in changed.items() if k != "role"},
            ),
        )  # fmt: skip

    return change


def controllers_take_over(patch):
    acquiring(role="operator")(patch)


def last_acquire_wins(patch):
    acquiring(role="operator", takeover=True)(patch)


def speed_ignored(patch):
    acquiring(speed=1.0)(patch)


def fences_do_not_grow(patch):
    def grant(self, robot, *arguments):
        self._fences[robot] = 0
        return right(self, robot, *arguments)

    right = Leases._grant
    patch.setattr(Leases, "_grant", grant)


def leases_never_expire(patch):
    patch.setattr(Leases, "expire", lambda self, now: [])
    around(
        patch,
        Leases,
        "renew",
        lambda right: lambda self, session, now, received: right(self, session, now + 1e6, 0.0),
    )


def pings_renew_nothing(patch):
    patch.setattr(Leases, "renew", lambda self, session, now, received: None)


def leases_kept_after_loss(patch):
    # The session stays known, as if the loss had not been noticed.
    patch.setattr(Core, "leave", lambda self, peer: None)
    patch.setattr(Leases, "expire", lambda self, now: [])


def losses_not_reported(patch):
    patch.setattr(Leasing, "_notice_of", lambda self, loss: [])


def release_by_any_session(patch):
    def release(self, robot, session, fence, now):
        grant = self._grants.get(robot)
        return right(self, robot, *((grant.session, grant.fence) if grant else (session, fence)), now)

    right = Leases.release
    patch.setattr(Leases, "release", release)


def stop_ignored(patch):
    def stop(self, peer, request):
        robots = self.robots if request.robot is None else (request.robot,)
        fields = {"stop": 1, "robots": robots, "reason": request.reason, "by": peer.client.name}
        peer.send(to_protocol.answer(m.Stopped, request, **fields))

    patch.setattr(Core, "_stop", stop)


def stop_sent_to_the_requester_only(patch):
    def announce_stop(self, stopped, asker, request):
        peers = self._peers
        self._peers = {} if asker is None else {asker.client.id: asker}
        reason = right(self, stopped, asker, request)
        self._peers = peers
        return reason

    right = Stopping.announce_stop
    patch.setattr(Stopping, "announce_stop", announce_stop)


def stop_of_one_robot_stops_all(patch):
    around(
        patch, Core, "_stop",
        lambda right: lambda self, peer, request: right(
            self, peer, request.model_copy(update={"robot": None})
        ),
    )  # fmt: skip


def stop_leaves_the_lease(patch):
    patch.setattr(Leasing, "stop", lambda self, robots, reason: [])


def stops_accumulate(patch):
    patch.setattr(Stops, "_to_replace", lambda self, robots, cause: None)


def more_stops_than_allowed(patch):
    def to_replace(self, robots, cause):
        same = (s.id for s in self._in_force.values() if (s.robots, s.cause) == (robots, cause))
        return next(same, None)

    patch.setattr(Stops, "_to_replace", to_replace)
    patch.setattr(to_protocol, "stops", lambda given: tuple(given[:64]))


def replaced_stops_unknown(patch):
    around(patch, Stops, "find", lambda right: lambda self, id_: self._in_force.get(id_))


def overtaken_resets_accepted(patch):
    def accept(right):
        def wrong(self, payload):
            self._overtaken = 0
            return right(self, payload)

        return wrong

    around(patch, connection.Connection, "_accept", accept)


def replaced_stops_lifted(patch):
    patch.setattr(Stopping, "_in_force", lambda self, stop: True)


def first_reason_only(patch):
    around(patch, to_protocol, "reasons", lambda right: lambda given: right(given)[:1])


def controllers_may_reset(patch):
    patch.setitem(RIGHTS, m.Reset, frozenset({"observer", "controller", "operator"}))


def observers_may_signal(patch):
    patch.setitem(RIGHTS, m.Signal, frozenset({"observer", "controller", "operator"}))


def signals_outlive_sessions(patch):
    patch.setattr(Signals, "drop", lambda self, session: None)


def signals_belong_to_all(patch):
    shared = Client("all", "all", "operator")
    around(patch, Signals, "set", lambda right: lambda self, client, *more: right(self, shared, *more))


def key_every_ignored(patch):
    patch.setattr(Subscription, "wants", lambda self, robot, tick: robot in self.robots)


def holder_not_shown(patch):
    around(patch, to_protocol, "entry", lambda right: lambda robot, view, holder: right(robot, view, None))


def faster_than_described(patch):
    def joint(robot, index):
        described = right(robot, index)
        update = {"velocity": described.velocity / 3, "acceleration": described.acceleration / 3}
        return described.model_copy(update=update)

    right = description_module._joint
    patch.setattr(description_module, "_joint", joint)


def brakes_harder_than_described(patch):
    def joint(robot, index):
        described = right(robot, index)
        return described.model_copy(update={"deceleration": described.deceleration / 3})

    right = description_module._joint
    patch.setattr(description_module, "_joint", joint)


def another_hash(patch):
    patch.setattr(assets, "_sha256", lambda text: hashlib.sha256(text.upper().encode()).hexdigest())


def versions_not_echoed(patch):
    around(
        patch, Greeter, "welcome",
        lambda right: lambda self, *a: right(self, *a).model_copy(update={"client_versions": (1,)}),
    )  # fmt: skip


def every_error_fatal(patch):
    around(
        patch, RemoteProtocolError, "message",
        lambda right: lambda self: right(self).model_copy(update={"fatal": True}),
    )  # fmt: skip


def errors_without_re(patch):
    around(
        patch, RemoteProtocolError, "message",
        lambda right: lambda self: right(self).model_copy(update={"re": None}),
    )  # fmt: skip


def large_frames_accepted(patch):
    patch.setattr(connection, "INBOUND_LIMIT", 1 << 20)


def doubled_keys_accepted(patch):
    patch.setattr(codec, "_unique", dict)


def deep_values_accepted(patch):
    patch.setattr(codec, "_is_deep", lambda value: False)


def garbage_skipped(patch):
    patch.setattr(codec, "_malformed", lambda text: RemoteProtocolError("invalid_message", text))


def bye_not_answered(patch):
    def process(self, item):
        if isinstance(item, m.Bye):
            self._ending.leave("bye")
            self.abort()
        else:
            right(self, item)

    right = Session._process
    patch.setattr(Session, "_process", process)


def pong_time_rounded(patch):
    around(
        patch, to_protocol, "answer",
        lambda right: lambda model, request, **fields: right(
            model, request, **(fields | {"time": round(fields["time"], 3)} if model is m.Pong else fields)
        ),
    )  # fmt: skip


def start_id_never_changes(patch):
    patch.setattr(daemon_module.secrets, "token_hex", lambda count: "0" * 2 * count)


class Gossip(m.Signaled):
    type: Literal["gossip"] = "gossip"


def unannounced_message_types(patch):
    patch.setattr(
        to_protocol, "signaled", lambda request: to_protocol.answer(Gossip, request, name=request.name)
    )


def distances_too_large(patch):
    around(
        patch, to_protocol, "entry",
        lambda right: lambda *a: farther(right(*a)),
    )  # fmt: skip


def states_accumulate(patch):
    patch.setattr(TcpPeerSocket, "is_read", lambda self: True)


def states_replaced_in_lockstep(patch):
    patch.setattr(Session, "keep_states", lambda self: None)


def stops_not_named(patch):
    around(
        patch,
        to_protocol,
        "text",
        lambda right: lambda given, end="": right(re.sub(r"\(stop [^)]*\)", "", given), end),
    )


def non_participants_wait_for_the_step(patch):
    def command(self, peer, command):
        if self._description.description.lockstep and peer.client.name not in ("kit-a", "kit-b"):
            self._late = [*getattr(self, "_late", ()), (peer, command)]
        else:
            right(self, peer, command)

    def tick(self, *a):
        late, self._late = getattr(self, "_late", ()), ()
        for item in late:
            right(self, *item)
        right_tick(self, *a)

    right, right_tick = Core.command, Core.tick
    patch.setattr(Core, "command", command)
    patch.setattr(Core, "tick", tick)


def done_is_forgotten(patch):
    def done(self, name):
        self._participants[name].done = False
        return right(self, name)

    right = Barrier.done
    patch.setattr(Barrier, "done", done)


def states_in_another_order(patch):
    def send_states(self, *states):
        return right(self, *reversed(states))

    right = Session.send_states
    patch.setattr(Session, "send_states", send_states)


def messages_with_hello_dropped(patch):
    def push(self, data):
        right(self, data)
        if self._there_was_none:
            self._there_was_none = False
            length = int.from_bytes(self._decoder._buffer[:4], "big")
            del self._decoder._buffer[4 + length :]

    right = connection.Connection.push
    patch.setattr(connection.Connection, "_there_was_none", True, raising=False)
    patch.setattr(connection.Connection, "push", push)


def states_delayed_by_messages_ahead(patch):
    patch.setattr(WriterBatch, "flush", lambda self: None)


def signals_depend_on_timing(patch):
    turns = count()
    around(
        patch, Signals, "set",
        lambda right: lambda self, *a: right(self, *a[:-1], float(next(turns))),
    )  # fmt: skip


def farther(entry):
    nearest = [pair.model_copy(update={"distance": 1.5 * pair.distance}) for pair in entry.nearest or ()]
    return entry.model_copy(update={"nearest": tuple(nearest)})


def finite(dq, n):
    return tuple(x if math.isfinite(x) else 0.0 for x in dq)


def fitted(dq, n):
    return (*dq, *[0.0] * n)[:n]


WRONG = {
    "two verdicts": (two_verdicts, "CMD-1/one", "session"),
    "no verdict for refused commands": (no_verdict_for_refused_commands, "CMD-2/echo", "session"),
    "verdicts out of order": (verdicts_out_of_order, "CMD-3/order", "session"),
    "verdicts to all sessions": (verdicts_to_all_sessions, "CMD-1/one", "session"),
    "moves by refused commands": (moves_by_refused_commands, "CMD-20/admitted", "safety"),
    "reports another increment than it plays": (reports_another_increment, "CMD-20/admitted", "session"),
    "old ticks accepted": (old_ticks_accepted, "CMD-13/stale", "safety"),
    "ticks ahead accepted": (old_ticks_accepted, "CMD-12/far", "session"),
    "two commands a tick": (two_commands_a_tick, "CMD-14/double", "session"),
    "NaN replaced by zero": (cleaned(finite), "CMD-16/nan", "safety"),
    "wrong lengths made to fit": (cleaned(fitted), "CMD-15/short", "safety"),
    "checks in another order": (checks_in_another_order, "CMD-7/stale-length", "session"),
    "refusals take the slot": (refusals_take_the_slot, "CMD-9/next", "session"),
    "fence ignored": (fence_ignored, "CMD-9/stolen", "safety"),
    "any fence of the holder": (any_fence_of_the_holder, "CMD-9/next", "safety"),
    "controllers take over": (controllers_take_over, "LEA-7/held", "session"),
    "the last acquire wins": (last_acquire_wins, "LEA-4/race", "session"),
    "speed of the lease ignored": (speed_ignored, "LEA-1/free", "session"),
    "fences do not grow": (fences_do_not_grow, "LEA-2/grows", "session"),
    "leases never expire": (leases_never_expire, "LEA-13/silence", "session"),
    "pings renew nothing": (pings_renew_nothing, "LEA-14/ping", "session"),
    "lease kept after loss": (leases_kept_after_loss, "LEA-16/close", "safety"),
    "losses not reported": (losses_not_reported, "LEA-8/takeover", "session"),
    "released by any session": (release_by_any_session, "LEA-12/other", "session"),
    "stop ignored": (stop_ignored, "CMD-10/stopped", "safety"),
    "stop sent to the requester only": (stop_sent_to_the_requester_only, "STP-2/everybody", "session"),
    "stop of one robot stops all": (stop_of_one_robot_stops_all, "STP-6/others", "session"),
    "stop leaves the lease": (stop_leaves_the_lease, "STP-5/lease", "session"),
    "stops accumulate": (stops_accumulate, "STP-15/again", "session"),
    "more stops than allowed": (more_stops_than_allowed, "STP-16/many", "session"),
    "replaced stops unknown": (replaced_stops_unknown, "STP-17/replaced", "session"),
    "overtaken resets accepted": (overtaken_resets_accepted, "MSG-12/overtaken", "session"),
    "replaced stops lifted": (replaced_stops_lifted, "STP-18/replaced", "session"),
    "the first reason only": (first_reason_only, "CMD-38/joints", "session"),
    "controllers may reset stops": (controllers_may_reset, "STP-8/controller", "session"),
    "observers may set signals": (observers_may_signal, "SIG-2/observer", "session"),
    "signals outlive their sessions": (signals_outlive_sessions, "SIG-4/gone", "session"),
    "signals belong to all": (signals_belong_to_all, "SIG-3/owned", "session"),
    "key every ignored": (key_every_ignored, "SUB-4/every-3", "session"),
    "holder not shown": (holder_not_shown, "STA-8/holder", "session"),
    "faster than described": (faster_than_described, "CMD-19/acceleration", "safety"),
    "brakes harder than described": (brakes_harder_than_described, "CMD-37/turn", "safety"),
    "another hash than the asset's": (another_hash, "DSC-9/urdf", "session"),
    "versions not echoed": (versions_not_echoed, "VER-5/unknown", "session"),
    "every error fatal": (every_error_fatal, "ERR-3/unknown", "session"),
    "errors without re": (errors_without_re, "ERR-6/about", "session"),
    "large frames accepted": (large_frames_accepted, "FRM-6/over", "session"),
    "doubled keys accepted": (doubled_keys_accepted, "PAY-4/twice", "session"),
    "deep values accepted": (deep_values_accepted, "PAY-5/too-deep", "session"),
    "garbage skipped": (garbage_skipped, "PAY-2/garbage", "session"),
    "bye not answered": (bye_not_answered, "CON-3/bye", "session"),
    "time of a pong rounded": (pong_time_rounded, "PNG-1/bits", "session"),
    "states accumulate": (states_accumulate, "SUB-11/pause", "session"),
    "stops not named": (stops_not_named, "LEA-23/named", "session"),
    "non-participants wait for the step": (non_participants_wait_for_the_step, "LCK-4/stranger", "session"),
    "done is forgotten": (done_is_forgotten, "LCK-18/done", "session"),
    "states in another order": (states_in_another_order, "LCK-16/instants", "session"),
    "messages with hello dropped": (messages_with_hello_dropped, "HEL-17/packet", "session"),
    "states delayed by messages ahead": (states_delayed_by_messages_ahead, "LCK-15/ahead", "session"),
    "states replaced in lock-step": (states_replaced_in_lockstep, "LCK-12/late", "session"),
    "signals depend on timing": (signals_depend_on_timing, "LCK-12/faster", "session"),
    "start id never changes": (start_id_never_changes, "HEL-11/anew", "session"),
    "unannounced message types": (unannounced_message_types, "EVO-4/unnamed", "session"),
    "distances too large": (distances_too_large, "STA-13/witness", "session"),
}


@pytest.mark.daily(6)
@pytest.mark.parametrize("name", WRONG)
async def test_the_case_for_a_deviation_fails(name, kit, monkeypatch):
    change, case, side = WRONG[name]
    change(monkeypatch)
    lockstep = {"files": LOCKSTEP, "participants": ("kit-a", "kit-b")} if case.startswith("LCK") else {}
    result = (await kit.results(case, within=CASE_TIMEOUT, **lockstep))[case]
    assert getattr(result, side) is Outcome.FAIL, (result.findings, result.wire[-10:])
    assert result.findings
    assert result.wire, "a failure without its wire log"
