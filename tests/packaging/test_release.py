"""Locked requirements, bills of materials and hardened units of a release."""

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
from tools.lock import LOCKS, ROOT, SITE, Lock, entries

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
UNITS = sorted((ROOT / "configs" / "systemd").glob("*.service"))
EXPOSURE = 3.0
"""Highest exposure level that systemd may assign to a unit."""


each_lock = pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.file)


def locked(*locks: Lock) -> dict[str, str]:
    texts = [entry for lock in locks for entry in entries(lock.path.read_text(encoding="utf-8"))]
    found = [re.match(r"([\w.-]+)==([^\s\\]+)", entry) for entry in texts]
    return {canonicalize_name(match[1]): match[2] for match in found}


@each_lock
def test_a_lock_names_exact_versions_with_hashes_and_nothing_else(lock: Lock) -> None:
    text = lock.path.read_text(encoding="utf-8")
    assert text.startswith(lock.header)
    for entry in entries(text):
        first, *rest = entry.replace("\\\n", "\n").split()
        assert re.fullmatch(r"[\w.-]+==[\w.+!-]+", first), entry
        hashes = [word for word in rest if word.startswith("--hash")]
        assert hashes
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", word) for word in hashes), entry
    assert not re.search(r"://|--(extra-)?index|find-links|/home/|/work/|/opt/", text)


@each_lock
def test_a_lock_satisfies_its_requirements(lock: Lock) -> None:
    versions = locked(lock)
    if lock is SITE:
        wanted = [line for line in (ROOT / lock.source).read_text().splitlines() if not line.startswith("#")]
    else:
        wanted = [*PROJECT["dependencies"]]
        wanted += [each for extra in lock.extras for each in PROJECT["optional-dependencies"][extra]]
    for requirement in map(Requirement, wanted):
        name = canonicalize_name(requirement.name)
        if name != "armgate":
            assert requirement.specifier.contains(versions[name]), f"{requirement}: run make lock"


@pytest.mark.parametrize("name", sbom.BILLS)
def test_a_bill_of_materials_lists_every_locked_package_with_its_hashes(name: str) -> None:
    locks = sbom.BILLS[name]
    text = "".join(lock.path.read_text(encoding="utf-8") for lock in locks)
    made = sbom.bill(text, PROJECT["version"])
    assert (made["bomFormat"], made["specVersion"], made["version"]) == ("CycloneDX", "1.6", 1)
    assert re.fullmatch(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", made["serialNumber"])
    listed = {(part["name"], part["version"]) for part in made["components"]}
    assert listed == {pair for lock in locks for pair in locked(lock).items()}
    refs = [part["bom-ref"] for part in made["components"]]
    assert len(set(refs)) == len(refs)
    assert made["dependencies"][0]["dependsOn"] == refs
    for part in made["components"]:
        assert part["purl"] == f"pkg:pypi/{part['name']}@{part['version']}"
        assert all(re.fullmatch(r"[0-9a-f]{64}", each["content"]) for each in part["hashes"])
    assert made == sbom.bill(text, PROJECT["version"])


def test_bills_of_materials_are_written(tmp_path: Path) -> None:
    sbom.main(str(tmp_path / "dist"))
    for name in sbom.BILLS:
        written = json.loads((tmp_path / "dist" / name).read_text(encoding="utf-8"))
        assert written["metadata"]["component"]["name"] == "armgate"


@pytest.mark.parametrize("entry", ["numpy\n", "numpy>=1 --hash=sha256:" + "0" * 64, "numpy==1.0\n"])
def test_an_entry_without_version_or_hash_is_an_error(entry: str) -> None:
    with pytest.raises(ValueError, match="lock file"):
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
def test_units_grant_only_needed_rights(unit: Path) -> None:
    own = settings(unit)
    assert {key: own[key][-1] for key in HARDENED} == HARDENED
    assert own["SystemCallFilter"] == ["@system-service", "~@privileged"]
    assert own["User"] not in ([], ["root"])


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_rates_the_exposure_of_units_low(unit: Path) -> None:
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
