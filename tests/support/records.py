"""Small recordings for tests, made without a daemon."""

from armgate import events as e
from armgate.protocol import messages as m
from armgate.recording import CellState, Header, LogLine, RecordingWriter, RobotState, Step, part_name

START = "feed"


def header(part=1, **more):
    description = m.Description(
        name="arms", hash="0" * 64, stop_distance=0.05, self_distance=0.02, response="stop", lockstep=False,
        robots=(), bodies=(),
    ).model_dump(mode="json")  # fmt: skip
    joint = {
        "name": "a1", "kind": "revolute", "unit": "rad", "lower": -3.0, "upper": 3.0, "velocity": 1.0,
        "acceleration": 4.0, "deceleration": None,
    }  # fmt: skip
    robot = {
        "name": "A", "urdf": {"hash": "1" * 64, "size": 3, "media": "application/xml"}, "joints": [joint],
        "base_xyz": [0.0, 0.0, 0.0], "base_xyzw": [0.0, 0.0, 0.0, 1.0], "period": 0.012, "start": [0.0],
        "frames": [], "tool": "tool0", "camera": None,
    }  # fmt: skip
    description["robots"] = [robot]
    fields = {
        "start": START, "origin_ns": 1_700_000_000_000_000_000, "cell": "arms", "hash": "0" * 64,
        "lockstep": False, "description": description, "part": part,
    }  # fmt: skip
    return Header(**(fields | more))


def tick_items(k, period=0.012):
    """Return the items of the k-th tick of robot A: event, state, and a log line at some ticks."""
    time = k * period
    tick = e.Tick("A", k, time, (0.001 * k,), (0.0011 * k,), (0.001,), e.PlanKey(START, 0, k, -1), 0)
    entry = m.Entry(robot="A", tick=k, time=time, q=(0.001 * k,), setpoint=(0.0011 * k,))
    signals = {"s": m.SignalValue(owner="x", value=(float(k),), time=time)}
    items = [Step(tick, ()), RobotState(entry), CellState(time, None, {"A": k}, signals, ())]
    if k % 50 == 0:
        items.append(LogLine(1.7e9 + time, "info", "hello", {"k": k}))
    return [(time, item) for item in items]


class File:
    """Unbuffered stream to a file: after a kill, all flushed bytes are in the file."""

    def __init__(self, path):
        self.file = path.open("xb", buffering=0)
        self.write, self.tell = self.file.write, self.file.tell

    def flush(self):
        pass


def write(folder, ticks=range(100), part=1, close=True, every=8, **more):
    """Write one file with these ticks, flushed at every eighth; return its path."""
    path = folder / part_name(part)
    stream = File(path)
    writer = RecordingWriter(stream, header(part, **more))
    for k in ticks:
        for time, item in tick_items(k):
            writer.put(item, time)
        if k % every == every - 1:
            writer.flush()
    if close:
        writer.close()
    stream.file.close()
    return path
