"""Live monitor on a scripted connection: stops that are late, refused or reset, and the backlog."""

from collections import deque
from types import SimpleNamespace

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.client import ConnectionLost, Refused, TimedOut
from armgate.monitor import live
from armgate.protocol import messages as m
from armgate.world.description import CellDescription
from support.cells import arms_yaml

HOME = (0.0, 0.7853981633974483, 0.7853981633974483)


class Line:
    """Scripted connection to a daemon: states, and seconds without one."""

    def __init__(self, library: CellDescription, script) -> None:
        self.description, self.welcome = library.description, SimpleNamespace(lockstep=False)
        self._assets = library.assets.by_hash
        self.now, self.reasons, self.fails = 100.0, [], []
        self._script = deque(script)
        self._kept, self._count = deque(maxlen=1), 0

    def subscribe(self, fields) -> None:
        assert "stops" in fields

    def states(self, timeout, backlog):
        self._kept = deque(self._kept, maxlen=backlog)
        seen = 0
        while True:
            dropped = self._count - len(self._kept)
            index = max(seen - dropped, 0)
            if index < len(self._kept):
                seen = dropped + index + 1
                yield self._kept[index]
            elif not self._script:
                raise ConnectionLost("the script ends")
            elif isinstance(self._script[0], float):
                self.now += self._script.popleft()
                raise TimedOut("no state")
            else:
                self.receive()

    def receive(self) -> None:
        state = self._script.popleft()
        self.now = max(self.now, 100.0 + state.time)
        self._kept.append(state)
        self._count += 1

    def asset(self, name):
        return self._assets[name]

    def ping(self):
        raise TimedOut("no answer to ping")

    def stop(self, reason):
        self.reasons.append(reason)
        if self.fails:
            error, seconds, arriving = self.fails.pop(0)
            self.now += seconds
            for _ in range(arriving):
                self.receive()
            if error is not None:
                raise error
        return SimpleNamespace(stop=len(self.reasons))


@pytest.fixture
def watched(tmp_path, monkeypatch):
    """Return a function that runs a script; it returns connection, printed lines and summary."""
    file = tmp_path / "cell.yaml"
    file.write_text(arms_yaml("A"))
    library = CellDescription(build_cell(load_config([file])), False)

    def run(script, *fails):
        line, lines = Line(library, script), []
        line.fails += fails
        clock = SimpleNamespace(monotonic=lambda: line.now, process_time=lambda: 0.0)
        monkeypatch.setattr(live, "time", clock)
        watch = live.LiveMonitor(line, [file], 1.0, lines.append)
        with pytest.raises(live.MonitorError, match=r"the script ends|no answer to ping"):
            watch.run(lambda: False)
        return line, lines, watch.summary

    return run


def state(tick: int, joint: float = 0.0, stops: tuple[int, ...] = (), **changes) -> m.State:
    """Return a state at rest; ``joint`` displaces the first joint."""
    q = (HOME[0] + joint, *HOME[1:])
    entry = {"robot": "A", "tick": tick, "time": tick * 0.012, "q": q, "setpoint": q, "stop_end": q}
    entry |= {"stops": stops, "link": "ready"} | changes
    return m.State(robot="A", tick=tick, time=entry["time"], entries=(m.Entry(**entry),))


def jump(tick: int, **more) -> list[m.State]:
    """Return a state with a violation, and two without a new one."""
    return [state(t, 0.3, **more) for t in range(tick, tick + 3)]


def test_a_stop_without_an_answer_is_reported_and_repeated(watched):
    script = [*map(state, range(5)), *jump(5), *(state(t, 0.3) for t in range(8, 10))]
    line, lines, _ = watched(script, (TimedOut("no answer"), 5.0, 0))
    assert len(line.reasons) == 2
    assert any("could not be stopped" in text for text in lines)
    assert "stopped the cell: stop 2" in lines


def test_a_finding_right_after_a_reset_stops_again_after_a_second(watched):
    """The first stop is reset at once; the second finding comes within a second."""
    script = [*map(state, range(5)), *jump(5), *(state(t) for t in range(8, 120))]
    line, lines, _ = watched(script)
    assert len(line.reasons) == 2
    assert "stopped the cell: stop 2" in lines


def test_a_finding_causes_no_stop_while_the_last_one_is_in_force(watched):
    script = [*map(state, range(5)), *jump(5), *(state(t, stops=(1,)) for t in range(8, 120))]
    assert len(watched(script)[0].reasons) == 1


def test_all_kept_states_are_checked_after_others_were_dropped(watched, monkeypatch):
    """A stop takes so long that the last checked state is no longer kept."""
    monkeypatch.setattr(live, "BACKLOG", 20)
    many = [state(t) for t in range(5, 65)]
    script = [*map(state, range(5)), *[0.1] * 11, *many, 0.1, *(state(t) for t in range(65, 70))]
    line, _, summary = watched(script, (None, 5.0, 60))
    assert len(line.reasons) == 1
    assert summary.states == 5 + 20 + 5


def test_checked_states_are_not_checked_again(watched):
    script = [*map(state, range(5)), 0.1, 0.1, *(state(t) for t in range(5, 9)), 0.1, state(9)]
    assert watched(script)[2].states == 10


def test_states_that_are_checked_late_are_noted_and_counted(watched):
    script = [*map(state, range(50)), 0.1]
    late = [state(t) for t in range(50, 60)]
    _, lines, summary = watched([*script, *late, 0.7, state(60, time=0.72), state(61, time=0.732)])
    assert summary.late == 2
    assert sum("0.7 s late" in text or "0.8 s late" in text for text in lines) == 1


def test_a_rule_that_is_violated_after_a_reset_stops_again(watched):
    wrong = {"q": HOME[:2]}
    script = [*map(state, range(3)), *(state(t, **wrong) for t in range(3, 5))]
    script += [state(t, stops=(1,), **wrong) for t in range(5, 100)]
    script += [state(t, **wrong) for t in range(100, 103)]
    line, lines, _ = watched(script)
    assert len(line.reasons) == 2
    assert "stopped the cell: stop 2" in lines


def test_a_robot_without_ticks_is_noted_and_a_dead_connection_ends_the_monitor(watched):
    line, lines, summary = watched([0.1] * 60)
    assert summary.unseen == ["A"]
    assert [text for text in lines if "no state yet of A" in text] == lines[1:]
    assert line.now < 100.0 + 50 * 0.1 + 0.05  # before the script ends


def test_ticks_that_come_twice_as_fast_stop_the_cell(watched):
    script = [state(t, time=t * 0.006) for t in range(500)]
    line, lines, summary = watched(script)
    assert {finding.kind for finding in summary.findings} == {"pace"}
    assert any("violated: A, tick" in text and "ticks of 12 ms arrived in" in text for text in lines)
    assert "ticks are early" in line.reasons[0]


def test_a_described_urdf_that_the_daemon_does_not_send_stops_the_cell(watched, monkeypatch):
    unknown = m.Error(code="unknown_asset", fatal=False, text="no such asset", about="asset")

    def refused(*_):
        raise Refused(unknown)

    monkeypatch.setattr(Line, "asset", refused)
    line, _, _ = watched([state(0)])
    assert len(line.reasons) == 1
    assert "A: the joints cannot be compared: the daemon does not send the described URDF" in line.reasons[0]
