"""The Ethernet object's outputs: what was received last, or nothing, as HOLDON says."""

from collections.abc import Mapping, Sequence

from armgate.emulator.krc.ethernet import CARTESIAN, ZERO, Element, Value


class Registers:
    """One value for each element that RECEIVE declares; zero before anything came."""

    def __init__(self, elements: Sequence[Element]) -> None:
        self._values: dict[Element, Value] = {element: ZERO[element.type] for element in elements}

    def take(self, received: Mapping[Element, Value]) -> tuple[str, ...]:
        """A cycle has passed in which ``received`` came; the names of those that did not.

        An element that did not come keeps its value with HOLDON 1; with HOLDON 0 it falls to zero.
        """
        missing = [element for element in self._values if element not in received]
        self._values.update({element: ZERO[element.type] for element in missing if not element.hold})
        self._values.update(received)
        return tuple(element.name for element in missing)

    def number(self, element: Element | None) -> float:
        """The value of a DOUBLE; zero where nothing is connected."""
        value = None if element is None else self._values[element]
        return value if isinstance(value, float) else 0.0

    def cartesian(self) -> tuple[str, ...]:
        """Return the names of Cartesian corrections, as RKorr.X, that are not zero."""
        return tuple(
            element.name
            for element, value in self._values.items()
            if element.attribute in CARTESIAN and element.type == "DOUBLE" and value
        )

    def named(self, name: str) -> Value | None:
        """The value of the element of this name; None if RECEIVE has none."""
        return next((value for element, value in self._values.items() if element.name == name), None)
