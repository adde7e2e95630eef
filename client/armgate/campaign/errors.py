"""Exceptions of campaigns; the command line prints their texts.

Tree::

    CampaignError       the campaign cannot go on (exit status 1)
    └── UsageError      the command was called incorrectly: a bad option, a changed file (exit status 2)
"""


class CampaignError(Exception):
    """End of a campaign; the text gives the reason and the remedy."""

    exit_code = 1


class UsageError(CampaignError):
    """Incorrect call; no trial was run."""

    exit_code = 2
