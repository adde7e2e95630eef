"""Basis of the keys: versions of the software, sources of Python entries, hashes of the cells."""

import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from armgate.campaign.campaign_file import CampaignConfig
from armgate.campaign.entries import source_hash
from armgate.campaign.trials import Basis
from armgate.cell.cell import Cell

LIBRARIES = ("armgate", "numpy", "pin", "coal", "python-fcl", "numba", "pydantic")
"""Distributions whose versions can change the figures of a trial."""


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries; absent ones are ``none``."""
    python = ".".join(map(str, sys.version_info[:2]))
    return {"python": python} | {name: _version(name) for name in LIBRARIES}


def basis_of(campaign: CampaignConfig, cells: Mapping[str, Cell]) -> Basis:
    """Return the basis of a campaign on this machine.

    Args:
        campaign: The campaign.
        cells: Cell of each scenario.

    Raises:
        EntryError: A Python entry cannot be imported.
    """
    sources = {entry: source_hash(entry, campaign.folder) for entry in sorted(_entries(campaign))}
    return Basis(versions(), sources, {name: cell.hash for name, cell in cells.items()})


def _entries(campaign: CampaignConfig) -> set[str]:
    programs = {one.program for each in campaign.controllers.values() for one in each.values()}
    return {figure.function for figure in campaign.figures.values()} | {one for one in programs if one}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"
