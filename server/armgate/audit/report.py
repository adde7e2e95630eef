"""Report of a recording: one self-contained HTML page."""

import base64
import html
import io
import math
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, assert_never

from armgate.cell.terminal_text import printable
from armgate.events import Outcome, Stopped, Verdict
from armgate.protocol import messages as m
from armgate.recording import CellState, Gap, Item, LogLine, Recording, RobotState, Step
from armgate.recording.reader import check_entry
from armgate.recording.verify import Chain, verify

_POINTS = 3000
"""Approximate number of points of a curve."""

_LONGEST = 2000
"""Longest text of a row, in characters."""

_MOST_SIGNALS = 24
"""Largest number of signals that are drawn."""

_LARGEST = 1e9
"""Largest value that is drawn."""

_BREAKS = 3
"""Largest number of breaks of the hash chain on the page."""

_LINES = 200
"""Largest number of log lines on the page."""

_COLOURS = {"admitted": "#4c9f70", "limited": "#d99a2b", "refused": "#c0392b"}


@dataclass
class RunData:
    """Data of a recording for the page."""

    verdicts: dict[str, Counter[str]] = field(default_factory=dict)
    bound: list[tuple[float, str, str]] = field(default_factory=list)
    times: dict[str, list[float]] = field(default_factory=dict)
    q: dict[str, list[Sequence[float]]] = field(default_factory=dict)
    clearance: dict[str, list[float]] = field(default_factory=dict)
    signals: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    log: list[tuple[float, LogLine]] = field(default_factory=list)
    stops: int = 0
    lost: int = 0
    end: float = 0.0

    def add(self, time: float, item: Item) -> None:
        """Add one item of the recording."""
        match item:
            case Step(outputs=outputs):
                self.stops += sum(isinstance(output, Stopped) for output in outputs)
                self._add_verdicts(time, outputs)
            case RobotState(entry=entry):
                self._add_entry(entry)
            case CellState(time=at, signals=signals):
                self.end = max(self.end, at)
                self._add_signals(at, signals)
            case LogLine(level=level):
                self.log += [(time, item)] if level != "info" else []
            case Gap(records=records):
                self.lost += records
            case _:
                assert_never(item)

    def _add_verdicts(self, time: float, outputs: Sequence[object]) -> None:
        for output in outputs:
            if isinstance(output, Verdict):
                cause = f" by {output.reasons[-1].cause.value}" if output.reasons else ""
                self.verdicts.setdefault(output.robot, Counter())[f"{output.outcome.value}{cause}"] += 1
                if output.outcome is not Outcome.ADMITTED:
                    self.bound.append((time, output.robot, output.outcome.value))

    def _add_signals(self, time: float, signals: Mapping[str, m.SignalValue]) -> None:
        for name, signal in signals.items():
            if len(signal.value) == 1:
                times, values = self.signals.setdefault(name, ([], []))
                times.append(time)
                values.append(signal.value[0])

    def _add_entry(self, entry: m.Entry) -> None:
        if entry.q is None:
            return
        self.times.setdefault(entry.robot, []).append(entry.time)
        self.q.setdefault(entry.robot, []).append(entry.q)
        near = [n.distance for n in entry.nearest or () if len({_owner(b) for b in n.pair}) == 2]
        self.clearance.setdefault(entry.robot, []).append(min(near, default=float("nan")))


def _owner(body: str) -> str:
    """Return the robot of a body, or the body itself if it belongs to the surroundings."""
    return body.partition("/")[0]


def report_page(recording: Recording) -> str:
    """Return the HTML page of a recording.

    Raises:
        DamagedError: A message was changed or damaged.
    """
    run = RunData()
    for time, item in recording.items():
        if isinstance(item, RobotState):
            check_entry(recording.path, recording.description, item.entry)
        run.add(time, item)
    header = recording.header
    began = datetime.fromtimestamp(header.origin_ns // 1_000_000_000, tz=UTC)
    counts = Counter[str]()
    for verdicts in run.verdicts.values():
        for what, number in verdicts.items():
            counts[what.partition(" ")[0]] += number
    facts = {
        "cell": f"{header.cell}, {header.hash[:12]}…",
        "began": f"{began:%Y-%m-%d %H:%M:%S} UTC",
        "lasted": f"{run.end:.1f} s{' of virtual time' if header.lockstep else ''}",
        "commands": _outcome_counts(counts),
        "least clearance": _least_clearance(run, recording.description.stop_distance),
        "stops": str(run.stops),
        "armgate": header.software.get("armgate", "?"),
        "gate": header.judge,
        "machine": header.machine.get("processor", "?"),
        "records lost": str(run.lost),
        "hash chain": _chain(verify(recording)),
    }
    parts = [f"<h1>{_shown(header.cell)}</h1>", _table(facts.items()), "<h2>Verdicts</h2>"]
    for robot, counts in sorted(run.verdicts.items()):
        parts.append(f"<h3>{_shown(robot)}</h3>{_table((k, str(n)) for k, n in counts.most_common())}")
    parts += _plots(run, recording)
    if run.log:
        lines = [(f"{time:.3f} s: {line.event}", _fields(line)) for time, line in run.log[:_LINES]]
        parts += ["<h2>Warnings and errors in the log</h2>", _table(lines)]
        if len(run.log) > _LINES:
            parts.append(f"<p>and {len(run.log) - _LINES} more</p>")
    return _PAGE.format(title=_shown(header.cell), body="\n".join(parts))


def _chain(chain: Chain) -> str:
    if not chain.present:
        return "none"
    if chain.breaks:
        return "broken: " + "; ".join(map(str, chain.breaks[:_BREAKS]))
    return f"intact, {'not sealed' if chain.unsealed else f'sealed {chain.seals[-1].digest.hex()}'}"


def _outcome_counts(counts: Counter[str]) -> str:
    parts = ", ".join(f"{counts[o.value]} {o.value}" for o in Outcome)
    return f"{counts.total()}: {parts}" if counts else "none"


def _least_clearance(run: RunData, required: float) -> str:
    """Return the smallest clearance of all states, and the required one."""
    seen = [value for values in run.clearance.values() for value in values if not math.isnan(value)]
    least = f"{1000 * min(seen):.1f} mm to others and surroundings" if seen else "not recorded"
    return f"{least}; {1000 * required:g} mm are required"


def _fields(line: LogLine) -> str:
    """Return the fields of a log line."""
    return "; ".join(f"{key}: {_listed(value)}" for key, value in line.fields.items())


def _listed(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}: a recorded run</title>
<style>body{{font:15px/1.45 system-ui,sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:#222}}
table{{border-collapse:collapse}}td{{padding:.15em 1.2em .15em 0;vertical-align:top}}
td:first-child{{color:#666}}
img{{max-width:100%}}h2{{margin-top:1.6em;border-bottom:1px solid #ddd}}</style></head>
<body>
{body}
</body></html>
"""


def _shown(text: str) -> str:
    return html.escape(printable(text[:_LONGEST]))


def _table(rows: Any) -> str:
    cells = (f"<tr><td>{_shown(k)}</td><td>{_shown(v)}</td></tr>" for k, v in rows)
    return f"<table>{''.join(cells)}</table>"


# --- plots ------------------------------------------------------------------------------------------------


def _plots(run: RunData, recording: Recording) -> list[str]:
    import matplotlib as mpl

    mpl.use("Agg")
    style = {
        "figure.dpi": 100,
        "font.size": 9.5,
        "axes.grid": True,
        "grid.alpha": 0.25,
        "lines.linewidth": 1.1,
        "text.parse_math": False,  # names come from the recording
    }
    description = recording.description
    with mpl.rc_context({**style, "axes.spines.top": False, "axes.spines.right": False}):
        found = ["<h2>Clearance</h2>", _figure(_clearance, run, description)]
        if run.bound:
            found += ["<h2>Limited and refused commands</h2>", _figure(_bound, run, description)]
        for robot in run.times:
            found += [f"<h2>{_shown(robot)}: joints</h2>", _figure(_joints, run, description, robot)]
        if run.signals:
            found += ["<h2>Signals</h2>", _figure(_signals, run, description)]
    return found


def _figure(draw: Any, *given: Any) -> str:
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(10.0, 3.4), layout="constrained")
    draw(axes, *given)
    axes.set_xlabel("daemon time [s]")
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a character in a name that the font lacks
        figure.savefig(buffer, format="png")
    plt.close(figure)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<img alt="plot" src="data:image/png;base64,{data}">'


def _clearance(axes: Any, run: RunData, description: m.Description) -> None:
    stop = 1000 * description.stop_distance
    for robot, values in run.clearance.items():
        axes.plot(*_thin(run.times[robot], [1000 * value for value in values]), label=_label(robot))
    axes.axhspan(0.0, stop, color="#c0392b", alpha=0.10, lw=0, label=f"stop distance {stop:g} mm")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("to others and surroundings [mm]")
    axes.legend(loc="upper right", ncols=4)


def _bound(axes: Any, run: RunData, _description: m.Description) -> None:
    robots = sorted({robot for _, robot, _ in run.bound})
    for outcome, colour in _COLOURS.items():
        at = [(time, robots.index(robot)) for time, robot, what in run.bound if what == outcome]
        seen = [(time, row) for time, row in at if abs(time) <= _LARGEST]
        if seen:
            axes.plot(*zip(*seen, strict=True), ls="", marker="|", ms=16, color=colour, label=outcome)
    axes.set_yticks(range(len(robots)), [_label(robot) for robot in robots])
    axes.set_ylim(-0.6, len(robots) - 0.4)
    axes.set_xlim(0.0, max(min(run.end, _LARGEST), 0.1))
    axes.legend(loc="upper right", ncols=2)


def _joints(axes: Any, run: RunData, description: m.Description, robot: str) -> None:
    joints = next(r for r in description.robots if r.name == robot).joints
    for number, joint in enumerate(joints):
        values = [q[number] for q in run.q[robot]]
        axes.plot(*_thin(run.times[robot], values), label=_label(f"{joint.name} [{joint.unit}]"))
    axes.set_ylabel("measured")
    if joints:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _signals(axes: Any, run: RunData, _description: m.Description) -> None:
    for name, (times, values) in list(run.signals.items())[:_MOST_SIGNALS]:
        axes.plot(*_thin(times, values), label=_label(name))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _label(text: str) -> str:
    """Return the label of a name; matplotlib omits labels that begin with an underscore."""
    shown = printable(text[:80])
    return f" {shown}" if shown.startswith("_") else shown


def _drawable(values: Sequence[float]) -> list[float]:
    return [value if abs(value) <= _LARGEST else math.nan for value in values]


def _thin(times: Sequence[float], values: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return fewer points: the lowest and the highest of each group, so that no extremum is lost."""
    times, values = _drawable(times), _drawable(values)
    step = max(1, 2 * len(times) // _POINTS)
    if step == 1:
        return list(times), list(values)
    at: list[int] = []
    for begin in range(0, len(times), step):
        among = range(begin, min(begin + step, len(times)))
        at += sorted({min(among, key=values.__getitem__), max(among, key=values.__getitem__)})
    return [times[i] for i in at], [values[i] for i in at]
