"""Pictures that explain limited and refused commands."""

import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.audit.explain import ExplainedCommand
from armgate.audit.replay_gate import IntendedMotion
from armgate.cell.cell import Body, Cell
from armgate.cell.terminal_text import printable
from armgate.events import Joints, Reason
from armgate.gate import support, support_table
from armgate.recording.files import atomic_write

Array = NDArray[np.float64]

_INK, _OTHER, _STOP, _WARN, _GREY = "#1f4e79", "#b8651b", "#4c9f70", "#c0392b", "#c9d0d6"
_STYLE = {
    "figure.dpi": 110, "font.size": 9.5, "axes.spines.top": False, "axes.spines.right": False,
    "text.parse_math": False, "axes.titlelocation": "left", "axes.titlesize": 10.0, "legend.frameon": False,
}  # fmt: skip
_NODES = 7
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 73)[:-1]


def draw_explanation(found: ExplainedCommand, cell: Cell, file: Path) -> bool:
    """Draw a command; return False if there is nothing to draw, because its motion is unknown."""
    import matplotlib as mpl

    mpl.use("Agg")
    reason = found.reason
    if found.intended is None:
        return False
    with mpl.rc_context(_STYLE):
        if reason is not None and reason.pair is not None and found.points is not None:
            _save(_clearance(found, found.intended, cell), file)
        else:
            _save(_joints(found, found.intended, cell), file)
    return True


def _save(figure: Any, file: Path) -> None:
    from matplotlib import pyplot as plt

    with atomic_write(file) as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a character in a name that the font lacks
        figure.savefig(stream, format="png")
    plt.close(figure)


def _title(found: ExplainedCommand) -> str:
    v = found.verdict
    return printable(f"{v.robot}, tick {found.tick}, {found.time:.3f} s: seq {v.seq} {v.outcome.value}")


# --- clearance --------------------------------------------------------------------------------------------


def _clearance(found: ExplainedCommand, intended: IntendedMotion, cell: Cell) -> Any:
    from matplotlib import pyplot as plt

    assert found.points is not None
    assert found.reason is not None
    a, b = (np.array(point) for point in found.points)
    view = view_along(a, b)
    figure, (whole, near) = plt.subplots(1, 2, figsize=(12.5, 5.8), layout="constrained")
    for axes in (whole, near):
        _scene(axes, found, intended, cell, view)
        _gap(axes, found, a, b, view)
        axes.set_aspect("equal")
        axes.set_ylabel("z [m]")
        axes.set_xlabel(_across(view))
    whole.autoscale_view()
    middle = view @ (0.5 * (a + b))
    limit = found.reason.bound or 0.05
    reach = max(0.35, 4.0 * limit, 1.3 * float(np.linalg.norm(b - a)))
    near.set_xlim(middle[0] - reach, middle[0] + reach)
    near.set_ylim(middle[1] - reach, middle[1] + reach)
    whole.set_title("The cell in side view")
    near.set_title("Around the nearest points, at the end of the stop")
    handles, labels = near.get_legend_handles_labels()
    kept = dict(zip(labels, handles, strict=True))
    figure.legend(kept.values(), kept.keys(), loc="outside lower center", ncols=4)
    figure.suptitle(f"{_title(found)}\n{_wrapped([found.reason])}", x=0.01, ha="left", fontweight="bold")
    return figure


def _across(view: Array) -> str:
    """Return the label of the horizontal axis: an axis of the world if it is parallel to one."""
    x, y = view[0][0], view[0][1]
    if max(abs(x), abs(y)) > 1.0 - 1e-6:
        return f"{'-' if x + y < 0 else ''}{'x' if abs(x) > abs(y) else 'y'} [m]"
    return f"along ({x:+.2f}, {y:+.2f}, 0) [m]"


def _scene(axes: Any, found: ExplainedCommand, intended: IntendedMotion, cell: Cell, view: Array) -> None:
    """Draw all bodies in grey, those of the pair in colour, and the moving one along its stop path."""
    assert found.reason is not None
    assert found.reason.pair is not None
    pair, moving = found.reason.pair, cell.robot_index(found.command.robot)
    for body in cell.bodies:
        q = _robot_position(found, cell, body)
        if q is None:
            continue
        if body.name not in pair:
            _fill(axes, outline(body, placed(cell, body, q), view), _GREY, 0.35, 1)
    for name, colour in zip(pair, (_INK, _OTHER), strict=True):
        body = next(body for body in cell.bodies if body.name == name)
        q = _robot_position(found, cell, body)
        if q is None:
            continue
        _fill(axes, outline(body, placed(cell, body, q), view), colour, 0.55, 3, label=f"{name} now")
        if body.robot == moving:
            _stop_path(axes, cell, body, intended, view)


def _stop_path(axes: Any, cell: Cell, body: Body, intended: IntendedMotion, view: Array) -> None:
    for q in _path(intended.q, intended.setpoint, intended.end):
        _line(axes, outline(body, placed(cell, body, q), view), _STOP, lw=0.8, zorder=2)
    end = outline(body, placed(cell, body, intended.end), view)
    _line(axes, end, _WARN, lw=1.6, zorder=5, ls="--", label=f"{body.name} at the end of its stop")
    axes.plot([], [], color=_STOP, lw=0.8, label="on its stop path")


def _gap(axes: Any, found: ExplainedCommand, a: Array, b: Array, view: Array) -> None:
    assert found.reason is not None
    p, q = view @ a, view @ b
    axes.plot(
        *zip(p, q, strict=True), color=_WARN, lw=1.4, marker="o", ms=4, zorder=6, label="nearest points"
    )
    distance, limit = 1000 * float(np.linalg.norm(b - a)), 1000 * (found.reason.bound or 0.0)
    text = f"{distance:.1f} mm\n{limit:.0f} mm required"
    axes.annotate(
        text, 0.5 * (p + q), xytext=(28, -6), textcoords="offset points", color=_WARN, zorder=7,
        bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8},
    )  # fmt: skip


def _robot_position(found: ExplainedCommand, cell: Cell, body: Body) -> Joints | None:
    if body.robot is None:
        return ()
    return found.positions[cell.robots[body.robot].name] or None


def _path(*corners: Joints) -> list[Joints]:
    """Return positions along the path from the measured position through the setpoint to the end."""
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


def _joints(found: ExplainedCommand, intended: IntendedMotion, cell: Cell) -> Any:
    """Draw increment and bounds of each joint, and its setpoint and end of stop between its limits."""
    from matplotlib import pyplot as plt

    robot = cell.robot(found.command.robot)
    bound = {reason.joint for reason in found.verdict.reasons if reason.joint}
    names = [joint.name for joint in robot.model.joints]
    rows = range(len(names))
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(12.0, 1.6 + 0.42 * len(names)), layout="constrained", sharey=True
    )
    _increments(left, found, intended, rows)
    _positions(right, intended, rows)
    left.set_yticks(list(rows), names)
    left.invert_yaxis()
    for label, name in zip(left.get_yticklabels(), names, strict=True):
        label.set_color(_WARN if name in bound else "black")
        label.set_fontweight("bold" if name in bound else "normal")
    why = _wrapped(found.verdict.reasons)
    figure.suptitle(f"{_title(found)}\n{why}", x=0.01, ha="left", fontweight="bold")
    return figure


def _increments(axes: Any, found: ExplainedCommand, intended: IntendedMotion, rows: Sequence[int]) -> None:
    speed = np.array(intended.bounds.speed) * intended.share
    commanded, played = np.array(intended.commanded) / speed, np.array(found.verdict.dq) / speed
    axes.axvspan(-1.0, 1.0, color=_STOP, alpha=0.10, lw=0, label="up to the largest speed")
    axes.barh(rows, played, height=0.5, color=_INK, label="played this tick")
    axes.plot(commanded, rows, ls="", marker="D", ms=5, color=_WARN, label="commanded")
    axes.plot(
        np.array(intended.last) / speed, rows, ls="", marker="|", ms=14, color="black", label="last tick"
    )
    reach = max(1.15, 1.1 * float(np.max(np.abs(np.concatenate([commanded, played])))))
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("increment, as a share of the largest")
    axes.set_title("Commanded and played increments")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2)


def _positions(axes: Any, intended: IntendedMotion, rows: Sequence[int]) -> None:
    low, high = np.array(intended.bounds.lower), np.array(intended.bounds.upper)

    def share(q: Sequence[float]) -> Array:
        return np.asarray((np.array(q) - low) / (high - low))

    now, end = share(intended.setpoint), share(intended.end)
    axes.barh(rows, np.ones(len(rows)), height=0.5, color=_GREY, alpha=0.5, label="between the joint limits")
    axes.plot(now, rows, ls="", marker="o", color=_INK, label="setpoint")
    axes.plot(end, rows, ls="", marker=">", color=_WARN, label="end of the stop")
    for row, a, b in zip(rows, now, end, strict=True):
        axes.plot([a, b], [row, row], color=_WARN, lw=1.4)
    axes.set_xlabel("position between the lower (0) and the upper limit (1)")
    axes.set_title("Setpoints, and positions at the end of the stop")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3)


def _wrapped(reasons: Sequence[Reason]) -> str:
    """Return the reasons, one per line."""
    return (
        "\n".join(shorten(printable(reason.text), 125, placeholder=" …") for reason in reasons)
        or "no check limited it"
    )


# --- outlines of bodies -----------------------------------------------------------------------------------


def placed(cell: Cell, body: Body, q: Joints) -> tuple[Array, Array]:
    """Return rotation (3, 3) and centre (3,) [m] of a body in the world, with its robot at q."""
    if body.robot is None:
        return np.asarray(body.placement.R), np.asarray(body.placement.t)
    R, t = cell.robots[body.robot].model.body_placements(q)
    return R[body.index], t[body.index]


def outline(body: Body, at: tuple[Array, Array], view: Array) -> Array:
    """Return the outline of a body in a plane: corners (72, 2) [m] of a polygon around it.

    Every body is convex, so its tangents p·d(φ) = h(d(φ)) enclose its outline. The corners are the
    intersections of neighbouring tangents.

    Args:
        body: The body.
        at: Its rotation and centre in the world.
        view: The two axes of the plane in the world, (2, 3).
    """
    R, t = at
    directions = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
    rows = support_table([body.shape])
    h = np.array([support(rows, (d @ view @ R)[None, :])[0] for d in directions])
    after = np.roll(directions, -1, axis=0)
    h_after = np.roll(h, -1)
    cross = directions[:, 0] * after[:, 1] - directions[:, 1] * after[:, 0]
    x = (h * after[:, 1] - h_after * directions[:, 1]) / cross
    y = (directions[:, 0] * h_after - after[:, 0] * h) / cross
    return np.asarray(np.stack([x, y], axis=1) + view @ t)


def view_along(a: Array, b: Array) -> Array:
    """Return the axes (2, 3) of the vertical plane through ``a`` and ``b``."""
    across = np.array([b[0] - a[0], b[1] - a[1], 0.0])
    length = float(np.linalg.norm(across))
    if length < 1e-3:
        across, length = np.array([1.0, 0.0, 0.0]), 1.0
    return np.stack([across / length, np.array([0.0, 0.0, 1.0])])
