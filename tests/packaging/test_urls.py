"""The addresses in the metadata are those of the repository from which a distribution is built."""

from pathlib import Path

import pytest

from tools.urls import urls, web_address


@pytest.mark.parametrize(
    ("remote", "address"),
    [
        ("https://forge.example/team/armgate.git", "https://forge.example/team/armgate"),
        ("https://me:secret@forge.example/team/armgate", "https://forge.example/team/armgate"),
        ("git@forge.example:team/armgate.git", "https://forge.example/team/armgate"),
        ("ssh://git@forge.example/team/armgate.git", "https://forge.example/team/armgate"),
        ("../main", ""),
        ("file:///srv/armgate.git", ""),
        ("", ""),
    ],
)
def test_a_remote_on_a_forge_has_a_web_address(remote: str, address: str) -> None:
    assert web_address(remote) == address


def test_the_environment_names_the_source(tmp_path: Path) -> None:
    found = urls(tmp_path, {"ARMGATE_URL": "https://forge.example/a/b"})
    assert found["Source"] == "https://forge.example/a/b"
    assert found["Issues"] == "https://forge.example/a/b/issues"


def test_without_a_repository_no_address_is_invented(tmp_path: Path) -> None:
    assert urls(tmp_path, {}) == {}


def test_a_wheel_keeps_the_addresses_of_its_source_distribution(tmp_path: Path) -> None:
    text = "Metadata-Version: 2.4\nName: armgate\nProject-URL: Source, https://forge.example/a/b\n\nText\n"
    (tmp_path / "PKG-INFO").write_text(text, encoding="utf-8")
    assert urls(tmp_path, {}) == {"Source": "https://forge.example/a/b"}
