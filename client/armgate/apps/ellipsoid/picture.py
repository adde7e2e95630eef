"""Picture of the arm at several positions with its ellipses, and its measures along the motion."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.apps.ellipsoid.motion import AXES, Motion
from armgate.apps.errors import UsageError
from armgate.control.redundancy.ellipsoids import Ellipsoid, force_ellipsoid, velocity_ellipsoid
from armgate.control.redundancy.measures import isotropy, manipulability

Array = NDArray[np.float64]

SIZE = 0.13
"""Longest semi-axis that is drawn, as a share of the picture's width."""
_CIRCLE = np.stack([np.cos(u := np.linspace(0.0, 2.0 * np.pi, 121)), np.sin(u)])
_FORCE, _INK = "#c0392b", "#1f4e79"
_STYLE = {
    "figure.dpi": 120, "font.size": 10.0, "axes.spines.top": False, "axes.spines.right": False,
    "axes.titlelocation": "left", "axes.titleweight": "bold", "legend.frameon": False,
    "svg.hashsalt": "armgate", "svg.fonttype": "none",
}  # fmt: skip


def draw(motion: Motion, file: Path, *, count: int, force: bool) -> str:
    """Draw the picture.

    Args:
        motion: The motion.
        file: Picture to write; its suffix .png or .svg selects the format.
        count: Number of positions.
        force: True to draw force ellipses, too.

    Returns:
        A line for users that describes the picture.

    Raises:
        UsageError: The file cannot be written, or has another suffix.
    """
    if file.suffix not in {".png", ".svg"}:
        raise UsageError(f"{file}: expected a file name that ends in .png or .svg")
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    with mpl.rc_context(_STYLE):
        figure = _figure(motion, count, force)
        try:
            figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)
        except OSError as error:
            raise UsageError(f"{file}: cannot be written ({error.strerror})") from error
        finally:
            plt.close(figure)
    w = [manipulability(motion.task.jacobian(q)) for q in motion.q]
    return f"{motion.title}: manipulability {min(w):.3g} to {max(w):.3g}; see {file}"


def _figure(motion: Motion, count: int, force: bool) -> Any:
    from matplotlib import pyplot as plt

    views = list(combinations(motion.rows, 2))
    if not views:
        raise UsageError(f"{motion.frame} moves along {motion.rows[0]} only; an ellipse needs two axes")
    figure = plt.figure(
        figsize=(4.3 * len(views) + 2.2, 7.2) if len(views) > 1 else (7.6, 8.4), layout="constrained"
    )
    top, bottom = figure.subfigures(2, 1, height_ratios=[2.7, 1.0])
    figure.suptitle(motion.title, x=0.01, ha="left", weight="bold")
    scene = _Scene(motion, count, force)
    axes = top.subplots(1, len(views), squeeze=False)[0]
    for axis, view in zip(axes, views, strict=True):
        scene.paint(axis, view)
    if len(motion.q) > 1:
        bar = top.colorbar(scene.colours, ax=list(axes), shrink=0.8, pad=0.02)
        bar.set_label("manipulability w")
    _measures(bottom, motion, scene)
    return figure


class _Scene:
    """Drawn positions, with their ellipsoids at a common scale."""

    def __init__(self, motion: Motion, count: int, force: bool) -> None:
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        self._motion = motion
        self.q = motion.pick(count)
        jacobians = [motion.task.jacobian(q) for q in self.q]
        self.w = [manipulability(J) for J in jacobians]
        all_w = [manipulability(motion.task.jacobian(q)) for q in motion.q]
        self.colours = ScalarMappable(Normalize(min(all_w), max(all_w)), colormaps["viridis"])
        self._lines = [motion.skeleton(q) for q in self.q]
        points = np.concatenate(self._lines)
        self._extent = float(np.ptp(points, axis=0).max())
        self._velocity = [velocity_ellipsoid(J) for J in jacobians]
        self._force = [force_ellipsoid(J) for J in jacobians] if force else []
        self._speed_scale = SIZE * self._extent / max(float(e.lengths.max()) for e in self._velocity)
        self._force_scale = self._scale_of_forces()

    def _scale_of_forces(self) -> float:
        """Return the scale, from the median of the longest axes: singularities make some of them huge."""
        longest = [float(e.lengths.max()) for e in self._force]
        finite = [length for length in longest if np.isfinite(length)]
        return SIZE * self._extent / (float(np.median(finite)) if finite else 1.0)

    def paint(self, axis: Any, view: tuple[str, str]) -> None:
        """Draw one view of all positions, along two world axes."""
        plane = [AXES.index(name) for name in view]
        rows = np.eye(len(self._motion.rows))[[self._motion.rows.index(name) for name in view]]
        for index, line in enumerate(self._lines):
            colour = self.colours.to_rgba(self.w[index]) if len(self.q) > 1 else _INK
            axis.plot(*line[:, plane].T, color=colour, lw=2.0, marker="o", ms=3.5, alpha=0.75, zorder=2)
            self._ellipse(axis, index, line[-1, plane], rows, colour)
        axis.set_aspect("equal", adjustable="datalim")
        axis.grid(alpha=0.2)
        axis.set_xlabel(f"{view[0]} [m]")
        axis.set_ylabel(f"{view[1]} [m]")
        axis.set_title(f"{view[0]}{view[1]}")
        axis.legend(handles=self._legend(), loc="best", fontsize=8.5)

    def _ellipse(self, axis: Any, index: int, centre: Array, rows: Array, colour: Any) -> None:
        shadow = self._velocity[index].projection(rows)
        outline = centre[:, None] + self._speed_scale * shadow.map(_CIRCLE)
        axis.fill(*outline, facecolor=colour, edgecolor="none", alpha=0.1, zorder=3)
        axis.plot(*outline, color=colour, lw=1.4, zorder=4)
        for half in (self._speed_scale * shadow.semi_axes).T:
            axis.plot(*np.stack([centre - half, centre + half]).T, color=colour, lw=0.7, zorder=4)
        if self._force:
            bounded = self._cut(self._force[index]).projection(rows)
            axis.plot(*(centre[:, None] + bounded.map(_CIRCLE)), color=_FORCE, lw=1.0, ls="--", zorder=4)

    def _cut(self, ellipsoid: Ellipsoid) -> Ellipsoid:
        """Return the ellipsoid in the picture's scale, with axes clipped to twice the usual length."""
        longest = 2.0 * SIZE * self._extent
        return Ellipsoid(ellipsoid.axes, np.minimum(self._force_scale * ellipsoid.lengths, longest))

    def _legend(self) -> list[Any]:
        from matplotlib.lines import Line2D

        speed = f"velocity, 1 m/s drawn as {100 * self._speed_scale:.2g} cm"
        shown = [Line2D([], [], color=_INK, lw=1.4, label=speed)]
        if self._force:
            text = f"force, 1 N drawn as {100 * self._force_scale:.2g} cm"
            shown.append(Line2D([], [], color=_FORCE, lw=1.0, ls="--", label=text))
        return shown


def _measures(figure: Any, motion: Motion, scene: _Scene) -> None:
    """Draw manipulability and isotropy along the motion, with marks at the drawn positions."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(motion.q, axis=0), axis=1))])
    jacobians = [motion.task.jacobian(q) for q in motion.q]
    axes = figure.subplots(1, 2)
    measures = (("manipulability w", manipulability), ("isotropy", isotropy))
    for axis, (label, measure) in zip(axes, measures, strict=True):
        values = [measure(J) for J in jacobians]
        axis.plot(way, values, color=_INK, lw=1.4, marker="o" if len(way) == 1 else "")
        for q in scene.q:
            at = way[int(np.argmin(np.linalg.norm(motion.q - q, axis=1)))]
            axis.axvline(at, color="#9aa5b1", lw=0.6, zorder=0)
        axis.set_ylim(0.0, 1.15 * max(values) if measure is manipulability and max(values) > 0.0 else 1.0)
        axis.set_ylabel(label)
        axis.set_xlabel("distance in joint space [rad, m]")
        axis.grid(alpha=0.25)
