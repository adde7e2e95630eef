"""Writes a software bill of materials, CycloneDX in JSON: ``python -m tools.sbom FILE``.

It is made from ``requirements.lock``. The same lock file and version give the same bytes.
"""

import json
import re
import sys
import tomllib
import uuid
from pathlib import Path
from typing import Any

from tools.lock import LOCK, ROOT, entries

_ENTRY = re.compile(r"([A-Za-z0-9._-]+)==([^\s\\;]+)")
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})\b")


def bill(lock: str, version: str) -> dict[str, Any]:
    """Return the bill of materials of a release.

    Args:
        lock: Content of the lock file.
        version: Of armgate.
    """
    parts = [_component(entry) for entry in entries(lock)]
    purl = f"pkg:pypi/armgate@{version}"
    own = {
        "type": "application", "bom-ref": purl, "name": "armgate", "version": version, "purl": purl,
        "licenses": [{"license": {"id": "Apache-2.0"}}],
    }  # fmt: skip
    refs = [part["bom-ref"] for part in parts]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": uuid.uuid5(uuid.NAMESPACE_URL, f"{purl}\n{lock}").urn,
        "version": 1,
        "metadata": {"component": own},
        "components": parts,
        "dependencies": [{"ref": own["bom-ref"], "dependsOn": refs}],
    }


def _component(entry: str) -> dict[str, Any]:
    """Return a package; each hash is that of one of its files, one of which is installed."""
    match = _ENTRY.match(entry)
    if match is None:
        raise ValueError(f"requirements.lock: {entry.splitlines()[0]!r}: expected NAME==VERSION")
    name, version = re.sub(r"[-_.]+", "-", match[1]).lower(), match[2]
    purl = f"pkg:pypi/{name}@{version}"
    hashes = [{"alg": "SHA-256", "content": content} for content in _HASH.findall(entry)]
    if not hashes:
        raise ValueError(f"requirements.lock: {name} has no hash; run: make lock")
    return {
        "type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl, "hashes": hashes,
    }  # fmt: skip


def main(file: str) -> None:
    """Write the bill of materials of this version."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    text = json.dumps(bill(LOCK.read_text(encoding="utf-8"), version), indent=2)
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    Path(file).write_text(text + "\n", encoding="utf-8")
    print(f"written: {file}")


if __name__ == "__main__":
    main(*sys.argv[1:])
