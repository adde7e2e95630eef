"""What a release ships beside the code: locked requirements, a bill of materials, hardened units."""

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tools import sbom
from tools.lock import EXTRAS, LOCK, ROOT, entries

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
UNITS = sorted((ROOT / "configs" / "systemd").glob("*.service"))
EXPOSURE = 3.0
"""Highest exposure level of a unit that systemd may find."""


def locked() -> dict[str, str]:
    found = [re.match(r"([\w.-]+)==([^\s\\]+)", entry) for entry in entries(LOCK.read_text())]
    return {canonicalize_name(match[1]): match[2] for match in found}


def test_the_lock_names_exact_versions_with_hashes_and_nothing_else() -> None:
    text = LOCK.read_text(encoding="utf-8")
    for entry in entries(text):
        first, *rest = entry.replace("\\\n", "\n").split()
        assert re.fullmatch(r"[\w.-]+==[\w.+!-]+", first), entry
        hashes = [word for word in rest if not word.startswith(("#", ";"))]
        assert hashes
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", word) for word in hashes), entry
    assert not re.search(r"://|--(extra-)?index|find-links|/home/|/work/|/opt/", text)


def test_the_lock_satisfies_what_the_project_requires() -> None:
    versions = locked()
    wanted = [*PROJECT["dependencies"], *(r for e in EXTRAS for r in PROJECT["optional-dependencies"][e])]
    for requirement in map(Requirement, wanted):
        name = canonicalize_name(requirement.name)
        if name != "armgate":
            assert requirement.specifier.contains(versions[name]), f"{requirement}: run make lock"


def test_the_bill_of_materials_lists_every_locked_package_with_its_hashes() -> None:
    made = sbom.bill(LOCK.read_text(), PROJECT["version"])
    assert (made["bomFormat"], made["specVersion"], made["version"]) == ("CycloneDX", "1.6", 1)
    assert re.fullmatch(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", made["serialNumber"])
    assert {part["name"]: part["version"] for part in made["components"]} == locked()
    refs = [part["bom-ref"] for part in made["components"]]
    assert len(set(refs)) == len(refs)
    assert made["dependencies"][0]["dependsOn"] == refs
    for part in made["components"]:
        assert part["purl"] == f"pkg:pypi/{part['name']}@{part['version']}"
        assert all(re.fullmatch(r"[0-9a-f]{64}", one["content"]) for one in part["hashes"])
    assert made == sbom.bill(LOCK.read_text(), PROJECT["version"])


def test_the_bill_of_materials_is_written(tmp_path: Path) -> None:
    sbom.main(str(tmp_path / "dist" / "armgate.cdx.json"))
    written = json.loads((tmp_path / "dist" / "armgate.cdx.json").read_text())
    assert written["metadata"]["component"]["name"] == "armgate"


@pytest.mark.parametrize("entry", ["numpy\n", "numpy>=1 --hash=sha256:" + "0" * 64, "numpy==1.0\n"])
def test_an_entry_without_version_or_hash_is_no_bill(entry: str) -> None:
    with pytest.raises(ValueError, match=r"requirements\.lock"):
        sbom.bill(entry, "1")


def settings(unit: Path) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in unit.read_text(encoding="utf-8").splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(key, []).append(value)
    return found


HARDENED = {
    "NoNewPrivileges": "yes", "CapabilityBoundingSet": "", "ProtectSystem": "strict", "ProtectHome": "yes",
    "PrivateTmp": "yes", "PrivateDevices": "yes", "ProtectKernelModules": "yes", "RestrictNamespaces": "yes",
    "RestrictSUIDSGID": "yes", "SystemCallArchitectures": "native", "UMask": "0077",
}  # fmt: skip


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_units_grant_only_what_is_needed(unit: Path) -> None:
    own = settings(unit)
    assert {key: own[key][-1] for key in HARDENED} == HARDENED
    assert own["SystemCallFilter"] == ["@system-service", "~@privileged"]
    assert own["User"] not in ([], ["root"])


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_finds_units_hardly_exposed(unit: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    assert analyze, "systemd-analyze is not installed; run: apt-get install systemd"
    done = subprocess.run(
        [analyze, "security", "--offline=true", "--no-pager", f"--threshold={10 * EXPOSURE:.0f}", unit],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-400:] + done.stderr
    level = re.search(r"Overall exposure level for .*: ([\d.]+)", done.stdout)
    assert level is not None
    assert float(level[1]) <= EXPOSURE
