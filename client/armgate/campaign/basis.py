"""Basis of the keys: versions of the software, sources of Python entries, hashes of the cells."""

import sys
from importlib.metadata import PackageNotFoundError, version

from armgate.campaign.campaign_file import CampaignConfig
from armgate.campaign.entries import source_hash
from armgate.campaign.trials import Basis
from armgate.campaign.variations import cell_tree
from armgate.cell.cell import build_cell
from armgate.cell.config import config_of

LIBRARIES = ("armgate", "numpy", "pin", "coal", "python-fcl", "numba", "pydantic")
"""Distributions whose versions can change the figures of a trial."""


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries; absent ones are ``none``."""
    python = ".".join(map(str, sys.version_info[:2]))
    return {"python": python} | {name: _version(name) for name in LIBRARIES}


def basis_of(campaign: CampaignConfig) -> Basis:
    """Return the basis of a campaign on this machine.

    Raises:
        ConfigError: The configuration of a cell is not valid.
        EntryError: A Python entry cannot be imported.
    """
    cells = {name: build_cell(config_of(cell_tree(campaign, name))).hash for name in campaign.scenarios}
    sources = {entry: source_hash(entry, campaign.folder) for entry in sorted(_entries(campaign))}
    return Basis(versions(), sources, cells)


def _entries(campaign: CampaignConfig) -> set[str]:
    programs = {one.program for each in campaign.controllers.values() for one in each.values()}
    return {figure.function for figure in campaign.figures.values()} | {one for one in programs if one}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"
