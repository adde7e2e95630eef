"""Charts of distributions as SVG: histogram and cumulative distribution, a colour per set of controllers."""

import html
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLOURS = ("#1f4e79", "#c8553d", "#2f7d4f", "#8a5fa8", "#b8860b", "#4a8fa3", "#7a7a7a", "#a23b72")
"""Colours of the sets of controllers, repeated if there are more."""
BINS = 30
"""Number of bins of a histogram."""
_WIDTH, _HEIGHT = 360, 180
_LEFT, _RIGHT, _TOP, _BOTTOM = 40, 12, 10, 28


def colour(index: int) -> str:
    """Return the colour of the set of controllers with this index."""
    return COLOURS[index % len(COLOURS)]


def number(value: float) -> str:
    """Return a number with three significant digits."""
    return f"{value:.0f}" if 999.5 <= abs(value) < 1e7 else f"{value:.3g}"


class Axis:
    """Horizontal axis over the values of all sets of controllers.

    Args:
        values: All values; at least one.
    """

    def __init__(self, values: Sequence[float]) -> None:
        low, high = float(np.min(values)), float(np.max(values))
        pad = 0.0 if high > low else 0.5 * (abs(low) or 1.0)
        self.low, self.high = low - pad, high + pad
        self.edges: Array = np.linspace(self.low, self.high, BINS + 1)

    def x(self, value: float) -> float:
        """Return the horizontal place of a value in the picture."""
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * (value - self.low) / (self.high - self.low)


def histogram(groups: Mapping[str, Sequence[float]], axis: Axis, goal: float | None = None) -> str:
    """Return the histogram of each group over one axis: the share of its trials in each bin."""
    shares = {
        name: np.histogram(values, axis.edges)[0] / max(1, len(values)) for name, values in groups.items()
    }
    top = max((float(share.max()) for share in shares.values()), default=0.0) or 1.0
    lines = [_steps(axis, share / top, colour(at)) for at, share in enumerate(shares.values())]
    return _frame("".join(lines), axis, goal, f"{100.0 * top:.0f} %")


def cumulative(groups: Mapping[str, Sequence[float]], axis: Axis, goal: float | None = None) -> str:
    """Return the cumulative distribution of each group over one axis."""
    lines = [_curve(axis, values, colour(at)) for at, values in enumerate(groups.values())]
    return _frame("".join(lines), axis, goal, "100 %")


def _y(share: float) -> float:
    return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (1.0 - share)


def _steps(axis: Axis, heights: Array, stroke: str) -> str:
    places = [f"{axis.x(axis.edges[0]):.1f},{_y(0.0):.1f}"]
    for at, height in enumerate(heights):
        places += [f"{axis.x(axis.edges[k]):.1f},{_y(float(height)):.1f}" for k in (at, at + 1)]
    places.append(f"{axis.x(axis.edges[-1]):.1f},{_y(0.0):.1f}")
    return _line(places, stroke, fill=True)


def _curve(axis: Axis, values: Sequence[float], stroke: str) -> str:
    """Return the line; it has at most some hundred points, for any number of values."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    kept = np.unique(np.linspace(0, len(ordered) - 1, 200).astype(int)) if len(ordered) else np.zeros(0, int)
    places, before = [], 0.0
    for at in kept:
        x = axis.x(float(ordered[at]))
        places += [f"{x:.1f},{_y(before):.1f}", f"{x:.1f},{_y((at + 1) / len(ordered)):.1f}"]
        before = (at + 1) / len(ordered)
    return _line(places, stroke)


def _line(places: Sequence[str], stroke: str, fill: bool = False) -> str:
    inside = f'fill="{stroke}" fill-opacity="0.18"' if fill else 'fill="none"'
    return f'<polyline points="{" ".join(places)}" {inside} stroke="{stroke}" stroke-width="1.5"/>'


def _frame(inside: str, axis: Axis, goal: float | None, top: str) -> str:
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    parts = [
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}" role="img">',
        f'<path d="M{_LEFT} {_TOP}V{bottom}H{right}" fill="none" stroke="#999"/>',
        _text(_LEFT - 4, _TOP + 9, top, "end"), _text(_LEFT - 4, bottom, "0", "end"),
        _text(_LEFT, bottom + 16, number(axis.low), "start"),
        _text(right, bottom + 16, number(axis.high), "end"),
        inside, _goal(axis, goal), "</svg>",
    ]  # fmt: skip
    return "".join(parts)


def _goal(axis: Axis, goal: float | None) -> str:
    if goal is None or not math.isfinite(goal) or not axis.low <= goal <= axis.high:
        return ""
    x = axis.x(goal)
    return f'<path d="M{x:.1f} {_TOP}V{_HEIGHT - _BOTTOM}" stroke="#444" stroke-dasharray="4 3"/>'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(text)}</text>'
