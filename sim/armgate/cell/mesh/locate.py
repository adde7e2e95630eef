"""Search for mesh files by path, ``file://`` or ``package://``."""

import os
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote, urlsplit

from armgate.cell.errors import ModelError
from armgate.cell.regular_file import is_file


def locate(uri: str, folder: Path, packages: Mapping[str, Path]) -> Path:
    """Return the file for a URI or path.

    ``package://NAME/rest`` is searched in ``packages``, then in the folders of ROS_PACKAGE_PATH, then among
    the folders that contain ``folder``: a description is often part of the package that it refers to.

    Args:
        uri: A path (relative ones start at ``folder``), ``file://…`` or ``package://…``.
        folder: Folder of the description that contains the URI.
        packages: Folders of packages by name.

    Raises:
        ModelError: There is no such package or file, or the URI is of another kind.
    """
    if "$(" in uri or "${" in uri:
        raise ModelError(
            f"{uri}: left over from xacro; expand the file first: xacro ROBOT.urdf.xacro > ROBOT.urdf"
        )
    path = _path(uri, folder, packages)
    if not is_file(path):
        raise ModelError(f"{_short(uri)}: there is no file {_short(str(path))}; check the name")
    return path


def _path(uri: str, folder: Path, packages: Mapping[str, Path]) -> Path:
    scheme, colon, rest = uri.partition("://")
    if not colon:
        return folder / uri
    if scheme == "file":
        return Path(unquote(_url_path(uri)))
    if scheme == "package":
        name, _, inside = rest.partition("/")
        return _package(name, folder, packages) / unquote(inside)
    raise ModelError(f"{uri}: {scheme}:// is not supported; expected a path, file:// or package://")


def _url_path(uri: str) -> str:
    try:
        return urlsplit(uri).path
    except ValueError as error:
        raise ModelError(f"{uri}: not a URI ({error}); expected a path, file:// or package://") from error


def _short(text: str) -> str:
    return text if len(text) <= 200 else text[:197] + "..."


def _package(name: str, folder: Path, packages: Mapping[str, Path]) -> Path:
    if name in packages:
        return packages[name]
    roots = [Path(entry) for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry]
    absolute = folder.absolute()
    for candidate in [*(root / name for root in roots), *roots, absolute, *absolute.parents]:
        if candidate.name == name and candidate.is_dir():
            return candidate
    raise ModelError(
        f"package {name!r} is not known; add its folder to meshes.packages or to ROS_PACKAGE_PATH"
    )
