"""Configuration of a robot's link: the keys of all kinds, and the emulated kind.

The model of any other kind is in the package that provides the kind; `link_kinds` finds it by name.
"""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from armgate.cell.config.fields import ConfigModel, Duration, Name


class LinkConfig(ConfigModel):
    """Base of the ``link`` section of a robot; each kind of link has a model of its own."""

    UNHASHED: ClassVar[frozenset[str]] = frozenset()
    """Keys that are not part of the cell's hash: they state the robot's address, not its behaviour."""
    EXACT_LAGS: ClassVar[bool] = False
    """True if the joints have exactly the configured lags; those of a real robot differ a little."""

    kind: str
    """Kind of the link."""
    lag: Annotated[Duration, Field(ge=0.0)] = 0.03
    """Time constant with which the measured position follows the setpoint [s]."""

    @property
    def joint_lags(self) -> Mapping[str, float]:
        """Time constants of joints that lag differently, by joint name, s."""
        return {}


class EmulatedLinkConfig(LinkConfig):
    """Link to an emulated robot, which follows its setpoint with a first-order lag."""

    EXACT_LAGS: ClassVar[bool] = True

    kind: Literal["emulated"] = "emulated"
    """Kind of the link."""
    lags: dict[Name, Annotated[Duration, Field(ge=0.0)]] = {}
    """Time constants of joints that lag differently, by joint name [s]."""

    @property
    def joint_lags(self) -> Mapping[str, float]:
        """Time constants of joints that lag differently, by joint name, s."""
        return self.lags
