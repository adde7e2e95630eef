"""Configurations that come with armgate, in the wheel or in the checkout."""

from pathlib import Path

from armgate.apps.errors import UsageError

_PACKAGED = Path(__file__).parent / "configs"
_CHECKOUT = Path(__file__).parents[3] / "configs"


def default_file(name: str) -> Path:
    """Return the path of a configuration that comes with armgate, such as ``demo.yaml``.

    The wheel contains ``configs/`` inside this package; an editable install reads the checkout. So a command
    without arguments behaves the same in every working directory.

    Raises:
        UsageError: The file is in neither place.
    """
    for folder in (_PACKAGED, _CHECKOUT):
        if (folder / name).is_file():
            return _short(folder / name)
    raise UsageError(
        f"{name}: not found in {_PACKAGED} nor in {_CHECKOUT}; give a configuration file on the command line"
    )


def _short(path: Path) -> Path:
    """Return a path below the working directory relative to it, because that is shorter to read."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
