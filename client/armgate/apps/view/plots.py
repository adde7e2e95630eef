"""Live plots of the camera's angle and distance error, from the signals of the follower."""

import math
from collections import deque
from typing import Any

import numpy as np

from armgate.client import State

SPAN = 30.0
"""Time span that is shown, s."""
POINTS = 600
_PLOTS = (
    ("follow.angle_error", "Angle error [deg]", math.degrees(1.0), "#e8590c"),
    ("follow.distance_error", "Distance error [mm]", 1000.0, "#1c7ed6"),
)


class Plots:
    """One plot per error; hidden until there are values."""

    def __init__(self, gui: Any) -> None:
        from viser import uplot

        self._times: deque[float] = deque(maxlen=POINTS)
        self._drawn: float | None = None
        self._values = [deque[float](maxlen=POINTS) for _ in _PLOTS]
        nothing = np.zeros(1)
        self._plots = [
            gui.add_uplot(
                (nothing, nothing),
                (uplot.Series(label="t"), uplot.Series(label=label, stroke=colour, width=2)),
                title=label,
                scales={"x": uplot.Scale(time=False)},
                legend=uplot.Legend(show=False),
                height=130,
                order=30 + number,
                visible=False,
            )
            for number, (_, label, _, colour) in enumerate(_PLOTS)
        ]

    def take(self, state: State) -> None:
        """Add the values of a state."""
        found = [state.signals.get(name) for name, *_ in _PLOTS]
        if self._times and not 0.0 <= state.time - self._times[-1] < SPAN:
            self._forget()  # the position in a recording was changed
        if any(signal is None for signal in found) or (self._times and state.time == self._times[-1]):
            return
        self._times.append(state.time)
        for values, signal, (_, _, factor, _) in zip(self._values, found, _PLOTS, strict=True):
            assert signal is not None
            values.append(factor * signal.value[0])

    def _forget(self) -> None:
        for values in (self._times, *self._values):
            values.clear()

    def draw(self) -> None:
        """Show the added values."""
        if len(self._times) < 2 or self._times[-1] == self._drawn:
            return
        self._drawn = self._times[-1]
        times = np.array(self._times)
        shown = times > times[-1] - SPAN
        for plot, values in zip(self._plots, self._values, strict=True):
            plot.data = (times[shown] - times[-1], np.array(values)[shown])
            plot.visible = True
