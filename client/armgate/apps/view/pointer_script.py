"""Reports of a page's pointer: a script presses two hidden buttons while the pointer is held down.

viser sends the value of a slider, but not its release. While the pointer is down on the page, the script
presses ``hold`` ten times a second. It presses ``release`` once when the pointer goes up, is cancelled, or
leaves the window. So a page that hangs or is closed stops reporting; a page that hung sends the missed
events when it recovers.

If several events occur in viser's panel within 50 ms, viser sends only the last one. In a slow browser, a
further ``hold`` could thus replace a press of another button, such as STOP. Therefore any other button ends
the presses of ``hold``, and movements of the pointer are ignored for a moment.
"""

from collections.abc import Callable
from typing import Any

EVERY = 100
"""Period of the presses of ``hold``, ms."""
IGNORED = 500
"""Time for which movements of the pointer are ignored after another button was pressed, ms."""

_SCRIPT = """
(() => {
  const gone = new AbortController();
  const press = id => {
    const button = document.getElementById(id);
    button ? button.click() : gone.abort();
  };
  let timer = 0;
  const up = () => {
    if (!timer) return;
    clearInterval(timer);
    timer = 0;
    press('RELEASE');
  };
  const held = () => timer && press('HOLD');
  let due = 0;
  const tick = () => {
    const now = performance.now();
    now > due + EVERY ? setTimeout(held, 0) : held();
    due = now + EVERY;
  };
  const down = event => {
    if (!event.isTrusted) return;
    up();
    due = performance.now() + EVERY;
    timer = setInterval(tick, EVERY);
    held();
  };
  let ignoredUntil = 0;
  const pressed = event => {
    const button = event.target.closest('button');
    if (!button || ['HOLD', 'RELEASE'].includes(button.id)) return;
    clearInterval(timer);
    timer = 0;
    ignoredUntil = performance.now() + IGNORED;
  };
  const moved = event => performance.now() > ignoredUntil || event.stopImmediatePropagation();
  const on = (target, kind, act, capture) =>
    target.addEventListener(kind, act, {capture, signal: gone.signal});
  gone.signal.addEventListener('abort', () => clearInterval(timer));
  on(window, 'pointerdown', down, true);
  on(window, 'pointerup', up, true);
  on(window, 'pointercancel', up, true);
  on(window, 'click', pressed, true);
  for (const kind of ['pointermove', 'mousemove', 'touchmove']) on(window, kind, moved, true);
  on(window, 'blur', up, false);
  on(document, 'visibilitychange', up, false);
})()
"""
_HIDDEN = '<style>div:has(> [id="HOLD"]), div:has(> [id="RELEASE"]) {display: none}</style>'
# An image that cannot be loaded runs its script; a script element that is inserted as text does not run.
_RUN = '<img alt="" src="data:," style="display:none" onerror="SCRIPT">'


def add_pointer_buttons(gui: Any, held: Callable[[], None], released: Callable[[], None]) -> None:
    """Report when the pointer of one page is held down, and when it is released.

    Args:
        gui: The GUI of that page, or of a folder in it.
        held: Called repeatedly while the pointer is held down.
        released: Called once when the pointer is released.
    """
    hold, release = gui.add_button("hold"), gui.add_button("release")

    # Coroutines: plain functions would run in threads that may overtake each other.
    async def pressed(_event: Any) -> None:
        held()

    async def release_pressed(_event: Any) -> None:
        released()

    hold.on_click(pressed)
    release.on_click(release_pressed)
    names = {"HOLD": _id(hold), "RELEASE": _id(release), "EVERY": str(EVERY), "IGNORED": str(IGNORED)}
    gui.add_html(_filled(_HIDDEN + _RUN.replace("SCRIPT", " ".join(_SCRIPT.split())), names))


def _filled(text: str, names: dict[str, str]) -> str:
    for name, value in names.items():
        text = text.replace(name, value)
    return text


def _id(handle: Any) -> str:
    """Return the id of the element that shows this control."""
    found: str = handle._impl.uuid
    return found
