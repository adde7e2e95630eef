"""Outputs of the RSI Ethernet object: the last received values, held or zeroed as HOLDON sets."""

from collections.abc import Mapping, Sequence

from armgate.emulator.krc.rsi.ethernet import CARTESIAN, ZERO, Element, Value


class ReceivedValues:
    """Value of each element that RECEIVE declares; zero before any reply."""

    def __init__(self, elements: Sequence[Element]) -> None:
        self._values: dict[Element, Value] = {element: ZERO[element.type] for element in elements}

    def update(self, received: Mapping[Element, Value]) -> tuple[str, ...]:
        """Store the values of a cycle; return the names of the missing ones.

        A missing element keeps its value with HOLDON 1, and becomes zero with HOLDON 0.
        """
        missing = [element for element in self._values if element not in received]
        self._values.update({element: ZERO[element.type] for element in missing if not element.hold})
        self._values.update(received)
        return tuple(element.name for element in missing)

    def number(self, element: Element | None) -> float:
        """Return the value of a DOUBLE; zero for None (no element is connected)."""
        value = None if element is None else self._values[element]
        return value if isinstance(value, float) else 0.0

    def cartesian(self) -> tuple[str, ...]:
        """Return the names of Cartesian corrections that are not zero, such as RKorr.X."""
        return tuple(
            element.name
            for element, value in self._values.items()
            if element.attribute in CARTESIAN and element.type == "DOUBLE" and value
        )

    def named(self, name: str) -> Value | None:
        """Return the value of the element of this name; None if RECEIVE has none."""
        return next((value for element, value in self._values.items() if element.name == name), None)
