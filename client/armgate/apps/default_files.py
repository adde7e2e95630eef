"""Where the configurations live that come with armgate: in the wheel, or in the checkout it runs from."""

from pathlib import Path

from armgate.apps.errors import UsageError

_PACKAGED = Path(__file__).parent / "configs"
_CHECKOUT = Path(__file__).parents[3] / "configs"


def default_file(name: str) -> Path:
    """Path of a configuration that comes with armgate, such as ``demo.yaml``.

    The wheel carries ``configs/`` inside this package; an editable install reads the checkout's. So a command
    without arguments does the same from every working directory.

    Raises:
        UsageError: Neither place has it.
    """
    for folder in (_PACKAGED, _CHECKOUT):
        if (folder / name).is_file():
            return _short(folder / name)
    raise UsageError(
        f"{name}: not found in {_PACKAGED} nor in {_CHECKOUT}; name a configuration file on the command line"
    )


def _short(path: Path) -> Path:
    """The path relative to the working directory where it lies below it: shorter to read."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
