"""Metrics of the daemon's health for Prometheus, served on this machine only.

The event loop stores the latest state here, and observes durations. Everything else is read on request, in
the thread of the HTTP server, from immutable values.
"""

from collections.abc import Callable, Iterator, Sequence
from time import perf_counter
from typing import Any

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Histogram,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from armgate.daemon.metrics.http_server import MetricsServer
from armgate.events import Command, GateEvent, GateOutput, LinkState
from armgate.gate import RobotView
from armgate.protocol import messages as m
from armgate.world.interfaces import Gate
from armgate.world.states import Snapshot

_SECONDS = (50e-6, 100e-6, 250e-6, 500e-6, 1e-3, 2e-3, 4e-3, 8e-3, 12e-3, 25e-3, 50e-3, 0.1)
"""Upper bounds of the buckets of histograms, s."""


class Metrics(Collector):
    """Metrics of one daemon.

    Args:
        queues: Returns the lengths of queues by name; called on request.
    """

    def __init__(self, queues: Callable[[], dict[str, int]]) -> None:
        self._queues = queues
        self._entries: Sequence[m.Entry] = ()
        disable_created_metrics()  # type: ignore[no-untyped-call]
        self._registry = CollectorRegistry()
        self._late = self._histogram(
            "armgate_tick_lateness_seconds", "Lateness of ticks when they are processed"
        )
        self._decision = self._histogram(
            "armgate_decision_seconds", "Time that the gate took to decide about a command"
        )
        self._registry.register(self)
        self._server: MetricsServer | None = None

    def _histogram(self, name: str, text: str) -> Histogram:
        return Histogram(name, text, registry=self._registry, buckets=_SECONDS)

    def serve(self, port: int) -> int:
        """Serve on 127.0.0.1; return the port.

        Raises:
            OSError: The port cannot be listened on.
        """
        server = MetricsServer(lambda: generate_latest(self._registry), CONTENT_TYPE_LATEST)
        port = server.open(port)
        self._server = server
        return port

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.close()

    def show(self, snapshot: Snapshot) -> None:
        """Store the latest state."""
        self._entries = snapshot.entries

    def late(self, seconds: float) -> None:
        """Observe the lateness of a tick, s."""
        self._late.observe(seconds)

    def timed(self, gate: Gate) -> Gate:
        """Return a gate that decides like the given one, and observe the time of its decisions."""
        return _TimedGate(gate, self._decision)

    def collect(self) -> Iterator[CounterMetricFamily | GaugeMetricFamily]:
        """Yield the metrics of the latest state."""
        entries = self._entries
        yield _verdicts(entries)
        nearest = {e.robot: min(n.distance for n in e.nearest) for e in entries if e.nearest}
        yield _gauge("armgate_clearance_meters", "Certified clearance of the nearest pair, m", nearest)
        least = {e.robot: e.least_clearance for e in entries if e.least_clearance is not None}
        yield _gauge(
            "armgate_least_clearance_meters",
            "Smallest clearance to other robots and surroundings so far, m",
            least,
        )
        stopped = {e.robot: len(e.stops or ()) for e in entries}
        yield _gauge("armgate_stops", "Stops in force", stopped)
        late = CounterMetricFamily("armgate_late_commands", "Plans that came too late", labels=["robot"])
        ticks = CounterMetricFamily("armgate_ticks", "Ticks of the robot's clock", labels=["robot"])
        link = GaugeMetricFamily(
            "armgate_link", "State of the link (1: current state)", labels=["robot", "state"]
        )
        for entry in entries:
            late.add_metric([entry.robot], entry.late_commands or 0)
            ticks.add_metric([entry.robot], entry.tick)
            for state in LinkState:
                link.add_metric([entry.robot, state.value], float(entry.link == state.value))
        yield from (late, ticks, link)
        yield _gauge("armgate_queue_depth", "Items that wait to be written or sent", self._queues(), "queue")


class _TimedGate:
    def __init__(self, gate: Gate, decision: Histogram) -> None:
        self._gate = gate
        self._decision = decision

    def step(self, event: GateEvent) -> list[GateOutput]:
        if not isinstance(event, Command):
            return self._gate.step(event)
        start = perf_counter()
        outputs = self._gate.step(event)
        self._decision.observe(perf_counter() - start)
        return outputs

    def view(self, robot: str) -> RobotView:
        return self._gate.view(robot)

    def warnings(self) -> tuple[str, ...]:
        return self._gate.warnings()


def _verdicts(entries: Sequence[m.Entry]) -> CounterMetricFamily:
    family = CounterMetricFamily(
        "armgate_verdicts", "Decided commands", labels=["robot", "outcome", "reason"]
    )
    for entry in entries:
        for key, count in (entry.counts or {}).items():
            outcome, _, reason = key.partition(":")
            family.add_metric([entry.robot, outcome, reason], count)
    return family


def _gauge(name: str, text: str, values: dict[str, Any], label: str = "robot") -> GaugeMetricFamily:
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], value)
    return family
