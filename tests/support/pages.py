"""The viewer's page in a browser: its texts, pictures and controls."""

import base64
import io
import re
from time import monotonic, sleep

import numpy as np
from PIL import Image

from support.pictures import where

PATIENCE = 60
GIZMO_X = (255, 32, 96)
# The camera's picture as the browser shows it: drawn from the page's own image element.
_PICTURE = """() => {
const image = [...document.querySelectorAll('img')].find(i => i.naturalWidth >= 320);
if (!image) return null;
const canvas = document.createElement('canvas');
canvas.width = image.naturalWidth; canvas.height = image.naturalHeight;
canvas.getContext('2d').drawImage(image, 0, 0);
return canvas.toDataURL('image/png');
}"""
_PRESS = """label => {
const button = [...document.querySelectorAll('button')].find(b => b.innerText.trim() === label);
if (button) button.click();
return !!button;
}"""
_SCENE = """() => {
const c = document.querySelector('canvas').getBoundingClientRect();
return [c.x, c.y, c.width, c.height];
}"""
_SLIDER = """name => {
const label = [...document.querySelectorAll('label')].find(l => l.innerText.trim() === name);
const track = label && document.getElementById(label.htmlFor);
if (!track) return null;
track.scrollIntoView({block: 'center'});
const knob = track.querySelector('.mantine-Slider-thumb').getBoundingClientRect();
const box = track.getBoundingClientRect();
return [knob.x + knob.width / 2, knob.y + knob.height / 2, box.width, box.x];
}"""


class Page:
    """Open page."""

    def __init__(self, browser, url, has="STOP"):
        self.browser, self.url = browser, url
        self.tab = browser.tab()
        self.tab.open(url)
        self.until(lambda: has in self.text and "FR" in self.text, "the panel")

    def until(self, condition, what):
        """Wait for a condition, and return its value."""
        end = monotonic() + PATIENCE
        while not (found := condition()):
            if monotonic() > end:
                raise AssertionError(f"not seen: {what}; the page: {self.text!r:.2000}")
            sleep(0.1)
        return found

    @property
    def text(self):
        """Visible text of the page."""
        return self.tab.evaluate("document.body.innerText")

    def joints(self, robot):
        """Return the joint values that the panel shows for a robot, as text."""
        lines = self.text.splitlines()
        words = ("running", "stop", "recorded")
        start = lines.index(
            robot, next((i for i, line in enumerate(lines) if any(word in line for word in words)), 0)
        )
        found = []
        for line in lines[start + 1 :]:
            if line in ("FR", "GR"):
                break
            if re.fullmatch(r"-?\d+\.\d(°|\d\d m)", line):
                found.append(line)
        return found

    @property
    def time(self):
        """Position in the recording that the page shows, s."""
        return float(self._moment[1])

    @property
    def length(self):
        """Length of the recording that the page shows, s."""
        return float(self._moment[2])

    @property
    def _moment(self):
        return self.until(lambda: re.search(r"([\d.]+) of ([\d.]+) s", self.text), "the moment that is shown")

    def press(self, label):
        """Press a button."""
        assert self.pressed(label), f"no button {label!r}"

    def pressed(self, label):
        """Press a button if it is there; return True if it was."""
        return self.tab.evaluate(_PRESS, label)

    def picture(self):
        """Return the camera's picture (height, width, 3); None while the browser loads one."""
        data = self.tab.evaluate(_PICTURE)
        if data is None:
            return None
        return np.array(Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))).convert("RGB"))

    def scene(self):
        """Return left, top, width and height of the 3-D view in the window."""
        return self.tab.evaluate(_SCENE)

    def screenshot(self):
        """Return the browser's picture (height, width, 3)."""
        return np.array(Image.open(io.BytesIO(self.tab.screenshot())).convert("RGB"))

    # --- a real pointer ------------------------------------------------------------------------------------

    def point(self, x, y, *, press=False):
        """Move the pointer; ``press`` holds its button down from then on."""
        self.tab.move(round(x), round(y))
        if press:
            self.tab.button_down()

    def release_pointer(self):
        """Release the pointer's button."""
        self.tab.button_up()

    def gizmo(self):
        """Return a point of the gizmo's first arrow in the window; None if it is not visible."""
        left, top, width, height = (int(value) for value in self.scene())
        seen = where(self.screenshot()[top : top + height, left : left + width], GIZMO_X, angle=0.06)
        found = np.argwhere(seen)
        if len(found) < 8:
            return None
        row, column = found[len(found) // 2]
        return left + int(column), top + int(row)

    def slider(self, label):
        """Return the middle of a slider's knob in the window, and the length of its track, pixels."""
        return self._slider(label)[:3]

    def along(self, label, share):
        """Return the place in the window at this share of a slider's track, pixels from the left."""
        _, _, width, left = self._slider(label)
        return left + share * width

    def _slider(self, label):
        found = self.tab.evaluate(_SLIDER, label)
        assert found, f"no slider {label!r}"
        return found
