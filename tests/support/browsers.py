"""Headless Chromium, driven by Playwright.

Playwright's synchronous interface runs an event loop in its thread, where asyncio cannot start another one.
Therefore the browser has its own thread, which makes every call.
"""

import contextlib
import os
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from playwright.sync_api import sync_playwright

ARTEFACTS = Path(__file__).parents[2] / "test-artefacts"
UNPACKED = Path(sys.prefix) / "browser"
"""Folder into which tools/system_needs.sh unpacks the browser of an npm package."""
NAMES = ("chromium", "chromium-browser", "google-chrome")
SIZE = (1000, 640)
PATIENCE_MS = 60_000.0
FLAGS = (
    "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-quic", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--lang=en-US",
)  # fmt: skip


def executable() -> Path:
    """Return the browser: the system's, else the unpacked one."""
    found = next(filter(None, map(shutil.which, NAMES)), None) or UNPACKED / "chromium"
    assert Path(found).exists(), "no Chromium; `make test` installs one, or run: apt-get install chromium"
    return Path(found)


class Tab:
    """One page of the browser. Its methods may be called from any one thread."""

    def __init__(self, run, page) -> None:
        self._run, self._page = run, page

    @property
    def url(self) -> str:
        """Address that the browser shows."""
        return self._run(lambda: self._page.url)

    def open(self, url: str) -> None:
        """Load a page."""
        self._run(lambda: self._page.goto(url))

    def reload(self) -> None:
        """Load the same page again."""
        self._run(self._page.reload)

    def close(self) -> None:
        """Close the page."""
        self._run(self._page.close)

    def evaluate(self, script: str, argument: object = None):
        """Return the value of an expression, or of a function of the argument; await promises."""
        return self._run(lambda: self._page.evaluate(script, argument))

    def before_load(self, script: str) -> None:
        """Run a script in every document before its own scripts."""
        self._run(lambda: self._page.add_init_script(script))

    def resize(self, width: int, height: int) -> None:
        """Set the size of the window's content, pixels."""
        self._run(lambda: self._page.set_viewport_size({"width": width, "height": height}))

    def screenshot(self) -> bytes:
        """Return what the browser shows, as PNG."""
        return self._run(self._page.screenshot)

    def move(self, x: float, y: float) -> None:
        """Move the pointer, pixels from the upper left."""
        self._run(lambda: self._page.mouse.move(x, y))

    def button_down(self) -> None:
        """Press the pointer's button and hold it."""
        self._run(self._page.mouse.down)

    def button_up(self) -> None:
        """Release the pointer's button."""
        self._run(self._page.mouse.up)

    def keep(self, name: str) -> Path:
        """Save a screenshot as an artefact of the tests."""
        ARTEFACTS.mkdir(exist_ok=True)
        file = ARTEFACTS / name
        file.write_bytes(self.screenshot())
        return file


class Browser:
    """A running browser."""

    def __init__(self, run, browser) -> None:
        self._run = run
        self._context = run(
            lambda: browser.new_context(viewport=dict(zip(("width", "height"), SIZE, strict=True)))
        )

    def tab(self) -> Tab:
        """Open an empty page."""

        def opened():
            page = self._context.new_page()
            page.set_default_timeout(PATIENCE_MS)
            return page

        return Tab(self._run, self._run(opened))


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser, and end it."""
    with ThreadPoolExecutor(1, "browser") as thread:

        def run(call):
            return thread.submit(call).result()

        playwright = run(lambda: sync_playwright().start())
        try:
            browser = run(lambda: _launched(playwright))
            yield Browser(run, browser)
            run(browser.close)
        finally:
            run(playwright.stop)


def _launched(playwright):
    path = executable()
    environment = dict(os.environ)
    if path.parent == UNPACKED:  # it needs the libraries that came with it, and an English locale
        environment["LD_LIBRARY_PATH"] = f"{UNPACKED}/lib:{UNPACKED}"
        environment["LANG"] = "en_US.UTF-8"
    return playwright.chromium.launch(
        executable_path=path, args=list(FLAGS), env=environment, chromium_sandbox=False
    )
