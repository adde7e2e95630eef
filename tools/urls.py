"""Metadata hook of the build: ``project.urls`` from the repository from which a distribution is built.

armgate does not name a host by itself, because forks and mirrors are equal. The address is that of the remote
``origin``, or ``ARMGATE_URL``; a wheel that is built from a source distribution keeps its addresses.
If there is none, the metadata has no URL.
"""

import email
import os
import re
import subprocess
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_REMOTE = re.compile(
    r"(?:https://(?:[^/@]*@)?|ssh://(?:[^/@]*@)?|[\w.-]+@)([\w.-]+\.\w+)[:/](.+?)(?:\.git)?/?$"
)


class UrlsHook(MetadataHookInterface):
    """Hook that hatchling calls, by ``tool.hatch.metadata.hooks.custom`` in pyproject.toml."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add ``urls`` to the metadata."""
        metadata["urls"] = urls(Path(self.root), os.environ)


def urls(root: Path, environment: Any) -> dict[str, str]:
    """Return the URLs by their labels."""
    packed = root / "PKG-INFO"
    if packed.exists():
        pairs = email.message_from_string(packed.read_text(encoding="utf-8")).get_all("Project-URL") or []
        return dict(pair.split(", ", 1) for pair in pairs)
    source = environment.get("ARMGATE_URL") or web_address(_origin(root))
    if not source:
        return {}
    return {"Source": source, "Issues": f"{source}/issues", "Changelog": f"{source}/blob/main/CHANGELOG.md"}


def web_address(remote: str) -> str:
    """Return the https address of a remote on a forge, without credentials; empty for any other remote."""
    match = _REMOTE.fullmatch(remote)
    return f"https://{match[1]}/{match[2]}" if match else ""


def _origin(root: Path) -> str:
    command = ["git", "-C", str(root), "config", "--get", "remote.origin.url"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()  # noqa: S603
    except OSError:
        return ""
