"""Lock-step instead of the configured clock."""

from collections.abc import Sequence

from armgate.cell.config.cell import CellConfig
from armgate.cell.config.daemon import LockstepClockConfig


def in_lockstep(config: CellConfig, participants: Sequence[str]) -> CellConfig:
    """Return a configuration whose clock is lock-step with these participants; a configured grace is kept.

    Raises:
        ValueError: There is no participant, or a name is not valid or occurs twice.
    """
    grace = {"grace": config.clock.grace} if isinstance(config.clock, LockstepClockConfig) else {}
    clock = LockstepClockConfig(kind="lockstep", participants=tuple(participants), **grace)
    return config.model_copy(update={"clock": clock})
