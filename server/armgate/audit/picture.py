"""Pictures of why a command was limited or refused."""

import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.audit.explaining import Case
from armgate.audit.outline import outline, placed, view_along
from armgate.cell.cell import Body, Cell
from armgate.cell.escaping import printable
from armgate.events import Joints, Reason
from armgate.gate import Intended
from armgate.recording.files import atomic_write

Array = NDArray[np.float64]

_INK, _OTHER, _STOP, _WARN, _GREY = "#1f4e79", "#b8651b", "#4c9f70", "#c0392b", "#c9d0d6"
_STYLE = {
    "figure.dpi": 110, "font.size": 9.5, "axes.spines.top": False, "axes.spines.right": False,
    "text.parse_math": False, "axes.titlelocation": "left", "axes.titlesize": 10.0, "legend.frameon": False,
}  # fmt: skip
_NODES = 7


def draw(case: Case, cell: Cell, file: Path) -> bool:
    """Draws a case; False if there is nothing to see: no position or no bound was involved."""
    import matplotlib as mpl

    mpl.use("Agg")
    reason = case.reason
    if case.intended is None:
        return False
    with mpl.rc_context(_STYLE):
        if reason is not None and reason.pair is not None and case.points is not None:
            _save(_clearance(case, case.intended, cell), file)
        else:
            _save(_joints(case, case.intended, cell), file)
    return True


def _save(figure: Any, file: Path) -> None:
    from matplotlib import pyplot as plt

    with atomic_write(file) as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a glyph that the font has not, in a name
        figure.savefig(stream, format="png")
    plt.close(figure)


def _title(case: Case) -> str:
    v = case.verdict
    return printable(f"{v.robot}, tick {case.tick}, {case.time:.3f} s: seq {v.seq} {v.outcome.value}")


# --- clearance --------------------------------------------------------------------------------------------


def _clearance(case: Case, intended: Intended, cell: Cell) -> Any:
    from matplotlib import pyplot as plt

    assert case.points is not None
    assert case.reason is not None
    a, b = (np.array(point) for point in case.points)
    view = view_along(a, b)
    figure, (whole, near) = plt.subplots(1, 2, figsize=(12.5, 5.8), layout="constrained")
    for axes in (whole, near):
        _scene(axes, case, intended, cell, view)
        _gap(axes, case, a, b, view)
        axes.set_aspect("equal")
        axes.set_ylabel("z [m]")
        axes.set_xlabel(_across(view))
    whole.autoscale_view()
    middle = view @ (0.5 * (a + b))
    limit = case.reason.bound or 0.05
    reach = max(0.35, 4.0 * limit, 1.3 * float(np.linalg.norm(b - a)))
    near.set_xlim(middle[0] - reach, middle[0] + reach)
    near.set_ylim(middle[1] - reach, middle[1] + reach)
    whole.set_title("The cell, seen from the side")
    near.set_title("Around the nearest points, at the end of the stop")
    handles, labels = near.get_legend_handles_labels()
    kept = dict(zip(labels, handles, strict=True))
    figure.legend(kept.values(), kept.keys(), loc="outside lower center", ncols=4)
    figure.suptitle(f"{_title(case)}\n{_wrapped([case.reason])}", x=0.01, ha="left", fontweight="bold")
    return figure


def _across(view: Array) -> str:
    """What runs to the right: an axis of the world where it is one."""
    x, y = view[0][0], view[0][1]
    if max(abs(x), abs(y)) > 1.0 - 1e-6:
        return f"{'-' if x + y < 0 else ''}{'x' if abs(x) > abs(y) else 'y'} [m]"
    return f"along ({x:+.2f}, {y:+.2f}, 0) [m]"


def _scene(axes: Any, case: Case, intended: Intended, cell: Cell, view: Array) -> None:
    """All bodies faintly, the pair's strongly, and the moving one's along the stop."""
    assert case.reason is not None
    assert case.reason.pair is not None
    pair, moving = case.reason.pair, cell.robot_index(case.command.robot)
    for body in cell.bodies:
        q = _position(case, cell, body)
        if q is None:
            continue
        if body.name not in pair:
            _fill(axes, outline(body, placed(cell, body, q), view), _GREY, 0.35, 1)
    for name, colour in zip(pair, (_INK, _OTHER), strict=True):
        body = next(body for body in cell.bodies if body.name == name)
        q = _position(case, cell, body)
        if q is None:
            continue
        _fill(axes, outline(body, placed(cell, body, q), view), colour, 0.55, 3, label=f"{name} now")
        if body.robot == moving:
            _stop_path(axes, cell, body, intended, view)


def _stop_path(axes: Any, cell: Cell, body: Body, intended: Intended, view: Array) -> None:
    for q in _way(intended.q, intended.setpoint, intended.end):
        _line(axes, outline(body, placed(cell, body, q), view), _STOP, lw=0.8, zorder=2)
    end = outline(body, placed(cell, body, intended.end), view)
    _line(axes, end, _WARN, lw=1.6, zorder=5, ls="--", label=f"{body.name} where its stop would end")
    axes.plot([], [], color=_STOP, lw=0.8, label="on its stop path")


def _gap(axes: Any, case: Case, a: Array, b: Array, view: Array) -> None:
    assert case.reason is not None
    p, q = view @ a, view @ b
    axes.plot(
        *zip(p, q, strict=True), color=_WARN, lw=1.4, marker="o", ms=4, zorder=6, label="nearest points"
    )
    distance, limit = 1000 * float(np.linalg.norm(b - a)), 1000 * (case.reason.bound or 0.0)
    text = f"{distance:.1f} mm\n{limit:.0f} mm to keep"
    axes.annotate(
        text, 0.5 * (p + q), xytext=(28, -6), textcoords="offset points", color=_WARN, zorder=7,
        bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8},
    )  # fmt: skip


def _position(case: Case, cell: Cell, body: Body) -> Joints | None:
    if body.robot is None:
        return ()
    return case.positions[cell.robots[body.robot].name] or None


def _way(*corners: Joints) -> list[Joints]:
    """Positions along measured – setpoint – end."""
    found: list[Joints] = []
    for a, b in pairwise(corners):
        steps = np.linspace(np.array(a), np.array(b), _NODES)
        found += [tuple(row) for row in steps.tolist()]
    return found


def _fill(axes: Any, corners: Array, colour: str, alpha: float, order: int, label: str | None = None) -> None:
    axes.fill(*corners.T, fc=colour, ec=colour, alpha=alpha, lw=0.8, zorder=order, label=label)


def _line(axes: Any, corners: Array, colour: str, **style: Any) -> None:
    closed = np.vstack([corners, corners[:1]])
    axes.plot(*closed.T, color=colour, alpha=0.8, **style)


# --- joints -----------------------------------------------------------------------------------------------


def _joints(case: Case, intended: Intended, cell: Cell) -> Any:
    """Each joint's increment against its bounds, and its place between its limits with the stop's end."""
    from matplotlib import pyplot as plt

    robot = cell.robot(case.command.robot)
    bound = {reason.joint for reason in case.verdict.reasons if reason.joint}
    names = [joint.name for joint in robot.model.joints]
    rows = range(len(names))
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(12.0, 1.6 + 0.42 * len(names)), layout="constrained", sharey=True
    )
    _increments(left, case, intended, rows)
    _places(right, intended, rows)
    left.set_yticks(list(rows), names)
    left.invert_yaxis()
    for label, name in zip(left.get_yticklabels(), names, strict=True):
        label.set_color(_WARN if name in bound else "black")
        label.set_fontweight("bold" if name in bound else "normal")
    why = _wrapped(case.verdict.reasons)
    figure.suptitle(f"{_title(case)}\n{why}", x=0.01, ha="left", fontweight="bold")
    return figure


def _increments(axes: Any, case: Case, intended: Intended, rows: Sequence[int]) -> None:
    speed = np.array(intended.bounds.speed) * intended.share
    asked, given = np.array(intended.asked) / speed, np.array(case.verdict.dq) / speed
    axes.axvspan(-1.0, 1.0, color=_STOP, alpha=0.10, lw=0, label="up to the largest speed")
    axes.barh(rows, given, height=0.5, color=_INK, label="plays this tick")
    axes.plot(asked, rows, ls="", marker="D", ms=5, color=_WARN, label="asked for")
    axes.plot(
        np.array(intended.last) / speed, rows, ls="", marker="|", ms=14, color="black", label="last tick"
    )
    reach = max(1.15, 1.1 * float(np.max(np.abs(np.concatenate([asked, given])))))
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("increment, as a share of the largest")
    axes.set_title("What was asked for, and what the robot does")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2)


def _places(axes: Any, intended: Intended, rows: Sequence[int]) -> None:
    low, high = np.array(intended.bounds.lower), np.array(intended.bounds.upper)

    def share(q: Sequence[float]) -> Array:
        return np.asarray((np.array(q) - low) / (high - low))

    now, end = share(intended.setpoint), share(intended.end)
    axes.barh(rows, np.ones(len(rows)), height=0.5, color=_GREY, alpha=0.5, label="between the joint limits")
    axes.plot(now, rows, ls="", marker="o", color=_INK, label="setpoint")
    axes.plot(end, rows, ls="", marker=">", color=_WARN, label="end of the stop")
    for row, a, b in zip(rows, now, end, strict=True):
        axes.plot([a, b], [row, row], color=_WARN, lw=1.4)
    axes.set_xlabel("place between the lower (0) and the upper limit (1)")
    axes.set_title("Where the joints are, and where they could brake to")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3)


def _wrapped(reasons: Sequence[Reason]) -> str:
    """The reasons, a line each."""
    return (
        "\n".join(shorten(printable(reason.text), 125, placeholder=" …") for reason in reasons)
        or "nothing bound it"
    )
