"""Writer of software bills of materials, CycloneDX in JSON: ``python -m tools.sbom FOLDER``.

Each is made from lock files: ``armgate.cdx.json`` lists the packages of a service, ``armgate-dev.cdx.json``
those for development, tests and documentation. The same lock files and version give the same bytes.
"""

import json
import re
import sys
import tomllib
import uuid
from pathlib import Path
from typing import Any

from tools.lock import DEVELOPMENT, ROOT, SERVICE, SITE, entries

BILLS = {"armgate.cdx.json": (SERVICE,), "armgate-dev.cdx.json": (DEVELOPMENT, SITE)}
_ENTRY = re.compile(r"([A-Za-z0-9._-]+)==([^\s\\;]+)")
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})\b")


def bill(lock: str, version: str) -> dict[str, Any]:
    """Return the bill of materials of a release.

    Args:
        lock: Content of the lock file; of several, one after the other.
        version: Version of armgate.

    Raises:
        ValueError: An entry has no exact version or no hash.
    """
    parts = {part["bom-ref"]: part for part in map(_component, entries(lock))}
    purl = f"pkg:pypi/armgate@{version}"
    own = {
        "type": "application", "bom-ref": purl, "name": "armgate", "version": version, "purl": purl,
        "licenses": [{"license": {"id": "Apache-2.0"}}],
    }  # fmt: skip
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": uuid.uuid5(uuid.NAMESPACE_URL, f"{purl}\n{lock}").urn,
        "version": 1,
        "metadata": {"component": own},
        "components": [*parts.values()],
        "dependencies": [{"ref": own["bom-ref"], "dependsOn": [*parts]}],
    }


def _component(entry: str) -> dict[str, Any]:
    """Return a package; each hash is that of one of its files, one of which is installed."""
    match = _ENTRY.match(entry)
    if match is None:
        raise ValueError(f"lock file: {entry.splitlines()[0]!r}: expected NAME==VERSION")
    name, version = re.sub(r"[-_.]+", "-", match[1]).lower(), match[2]
    purl = f"pkg:pypi/{name}@{version}"
    hashes = [{"alg": "SHA-256", "content": content} for content in _HASH.findall(entry)]
    if not hashes:
        raise ValueError(f"lock file: {name} has no hash; run: make lock")
    return {
        "type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl, "hashes": hashes,
    }  # fmt: skip


def main(folder: str) -> None:
    """Write the bills of materials of this version."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, locks in BILLS.items():
        text = "".join(lock.path.read_text(encoding="utf-8") for lock in locks)
        (Path(folder) / name).write_text(json.dumps(bill(text, version), indent=2) + "\n", encoding="utf-8")
        print(f"written: {folder}/{name}")


if __name__ == "__main__":
    main(*sys.argv[1:])
