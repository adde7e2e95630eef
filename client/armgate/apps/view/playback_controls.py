"""Play, pause, speed and a time slider for a recording."""

from time import monotonic
from typing import Any

from armgate.apps.view.player import Player

SPEEDS = ("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "4 ×", "8 ×")
LEFT_ALONE = 0.7
"""Time for which the slider is not moved after a user moved it, s."""
PLAY, PAUSE = "Play", "Pause"


class PlaybackControls:
    """Controls of one player, shared by all pages.

    Args:
        gui: The GUI of viser's server.
        player: The player that they control.
    """

    def __init__(self, gui: Any, player: Player) -> None:
        self._player, self._touched = player, -LEFT_ALONE
        self._button = gui.add_button(PLAY, icon="player-play", order=1)
        self._slider = gui.add_slider("Time [s]", 0.0, max(round(player.length, 2), 0.01), 0.01, 0.0, order=2)
        speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1 ×", order=3)

        async def pressed(_event: Any) -> None:
            player.play(not player.playing)
            self.show()

        async def moved(event: Any) -> None:
            if event.client is not None:  # otherwise this process set it
                self._touched = monotonic()
                player.seek(float(self._slider.value))

        async def chosen(_event: Any) -> None:
            player.set_speed(float(speed.value.split()[0]))

        self._button.on_click(pressed)
        self._slider.on_update(moved)
        speed.on_update(chosen)

    def show(self) -> None:
        """Show the position of the player."""
        label = PAUSE if self._player.playing else PLAY
        if self._button.label != label:
            self._button.label = label
            self._button.icon = "player-pause" if label == PAUSE else "player-play"
        if monotonic() - self._touched > LEFT_ALONE:
            self._slider.value = min(round(self._player.time, 2), self._slider.max)
