"""How a page tells that its pointer is held down: by two buttons that nobody sees, which a script presses.

viser tells of a slider what value it has, not that it was let go. While the pointer is down on the page, the
script presses ``hold`` ten times a second, and ``release`` once when it goes up, is cancelled, or the window
loses it. So a page that hangs or is closed says nothing any more; one that hung first hears what happened.

Of all that happens in its panel within 50 ms viser sends what came last, and a slow browser comes to the next
press of ``hold`` before it sends. So another button that is pressed, STOP first of all, ends the hold, and
for a moment nothing that moves under the pointer is heard: nothing may come after it.
"""

from collections.abc import Callable
from typing import Any

EVERY = 100
"""Time between two presses of ``hold``, ms."""
DEAF = 500
"""How long no movement of the pointer is heard after another button was pressed, ms."""

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
  const beat = () => {
    const now = performance.now();
    now > due + EVERY ? setTimeout(held, 0) : held();
    due = now + EVERY;
  };
  const down = event => {
    if (!event.isTrusted) return;
    up();
    due = performance.now() + EVERY;
    timer = setInterval(beat, EVERY);
    held();
  };
  let deaf = 0;
  const pressed = event => {
    const button = event.target.closest('button');
    if (!button || ['HOLD', 'RELEASE'].includes(button.id)) return;
    clearInterval(timer);
    timer = 0;
    deaf = performance.now() + DEAF;
  };
  const moved = event => performance.now() > deaf || event.stopImmediatePropagation();
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
# An image that cannot be loaded runs its script: text that is put into a page runs none of its own.
_RUN = '<img alt="" src="data:," style="display:none" onerror="SCRIPT">'


def add_pointer_buttons(gui: Any, held: Callable[[], None], released: Callable[[], None]) -> None:
    """Has one page say when its pointer is held down, and when it is let go.

    Args:
        gui: That page's own, or a folder's in it.
        held: Called again and again while it is held.
        released: Called once when it was let go.
    """
    hold, release = gui.add_button("hold"), gui.add_button("release")

    # Coroutines: plain functions would run in threads that may overtake each other.
    async def pressed(_event: Any) -> None:
        held()

    async def let_go(_event: Any) -> None:
        released()

    hold.on_click(pressed)
    release.on_click(let_go)
    names = {"HOLD": _id(hold), "RELEASE": _id(release), "EVERY": str(EVERY), "DEAF": str(DEAF)}
    gui.add_html(_filled(_HIDDEN + _RUN.replace("SCRIPT", " ".join(_SCRIPT.split())), names))


def _filled(text: str, names: dict[str, str]) -> str:
    for name, value in names.items():
        text = text.replace(name, value)
    return text


def _id(handle: Any) -> str:
    """The id of the element that shows this control."""
    found: str = handle._impl.uuid
    return found
