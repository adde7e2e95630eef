"""A real browser without a screen."""

import contextlib
import shutil
from pathlib import Path

from selenium import webdriver

ARTEFACTS = Path(__file__).parents[2] / "test-artefacts"
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--window-size=1000,640",
)  # fmt: skip


@contextlib.contextmanager
def chromium(profile: Path):
    """Debian's Chromium, driven by Selenium."""
    paths = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    missing = [name for name, path in paths.items() if path is None]
    assert not missing, f"not installed: {missing}; run: apt-get install chromium chromium-driver"
    options = webdriver.ChromeOptions()
    options.binary_location = paths["chromium"]
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    service = webdriver.ChromeService(paths["chromedriver"])
    browser = webdriver.Chrome(options=options, service=service)
    try:
        browser.set_script_timeout(30)
        yield browser
    finally:
        browser.quit()


def keep(browser, name: str) -> Path:
    """Keeps a screenshot as an artefact of the tests."""
    ARTEFACTS.mkdir(exist_ok=True)
    file = ARTEFACTS / name
    assert browser.save_screenshot(str(file))
    return file
