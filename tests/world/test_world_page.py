"""The programs of docs/world.md run and do what the page states."""

import contextlib
import io
import re
from pathlib import Path

import pytest

from armgate.events import Tick
from armgate.recording import Recording

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "world.md").read_text(encoding="utf-8")
MOVE, COPY, RECORD = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def namespace(tmp_path, monkeypatch):
    """Return the names of the first program after its end, and its output as ``printed``."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    names, output = {}, io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(MOVE, names)
    return names | {"printed": output.getvalue()}


def test_the_first_program_moves_a_robot_in_ten_lines(namespace):
    statements = [line for line in MOVE.splitlines() if line and not line.startswith("from ")]
    assert len(statements) <= 10
    lines = namespace["printed"].splitlines()
    assert len(lines) == 84  # 1 s in ticks of 12 ms
    first, last = (float(re.match(r"\(([^,]+),", line)[1]) for line in (lines[0], lines[-1]))
    assert first == 0.0
    assert last > 0.1
    assert {line.rpartition(" ")[2] for line in lines} <= {"admitted", "limited", "refused"}


def test_the_copies_continue_where_the_world_is(namespace):
    exec(COPY, namespace)
    world, fork, other = (namespace[name] for name in ("world", "fork", "other"))
    assert fork.time == other.time == world.time
    assert namespace["again"].session == namespace["me"].session
    fork.step()
    assert fork.time > world.time


def test_the_recording_has_all_steps(namespace):
    exec(RECORD, namespace)
    events = [step.event for _, step in Recording.open(Path("runs/world")).steps()]
    ticks = [event.tick for event in events if isinstance(event, Tick)]
    assert ticks == list(range(101))
