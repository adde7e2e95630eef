"""Checks that a KRC's RSI Ethernet file declares what a link has to read and write."""

import ipaddress

from armgate.links.rsi.axes import AXES, Axis
from armgate.links.rsi.ethernet_file import Ethernet, Received
from armgate.links.rsi.telegram import LONGEST_REPLY, ReplyWriter

_POSITIONS = {"A": ("AIPos", "ASPos"), "E": ("EIPos", "ESPos")}
"""Measured and programmed position, by kind of axis."""
_HOLDING = {
    False: '0: one lost reply would command a jump back to the programmed position; expected HOLDON="1"',
    True: '1: in relative mode a lost reply would be added again and again; expected HOLDON="0"',
}


def file_objection(
    ethernet: Ethernet, axes: tuple[Axis, ...], *, programmed: bool, relative: bool
) -> str | None:
    """Return the first objection to a KRC's file, None if it fits.

    Args:
        ethernet: The file.
        axes: The robot's axes.
        programmed: True if the programmed position has to be sent, too.
        relative: True if corrections are added up.
    """
    return (
        _sent_objection(ethernet, axes, programmed)
        or _received_objection(ethernet, axes, relative)
        or _length_objection(ReplyWriter(ethernet, axes), len(axes))
    )


def unsent_values(ethernet: Ethernet) -> tuple[str, ...]:
    """Return the values that no reply carries: the KRC reads them as zero, which may have a meaning."""
    carried = _corrections(ethernet)
    others = [one for one in ethernet.received if one not in carried]
    return tuple(one.name for one in others if one.tag != "RKorr" and one.name not in ("EStr", "Stop"))


def is_host(text: str) -> bool:
    """Return True for the address of one machine: neither a placeholder, 0.0.0.0, broadcast nor multicast."""
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return False
    return not (address.is_unspecified or address.is_multicast or text == "255.255.255.255")


def _sent_objection(ethernet: Ethernet, axes: tuple[Axis, ...], programmed: bool) -> str | None:
    if ethernet.only_send:
        return "ONLYSEND is TRUE: the KRC would not read replies; expected FALSE"
    kinds = {axis.name[0] for axis in axes}
    held = [tags for kind, tags in _POSITIONS.items() if kind in kinds]
    wanted = ["Delay", *(tag for tags in held for tag in (tags if programmed else tags[:1]))]
    missing = [f"DEF_{tag}" for tag in wanted if tag not in ethernet.sent]
    if not missing:
        return None
    option = ""
    if all(tag[5] == "S" for tag in missing):  # DEF_ASPos, DEF_ESPos
        option = (
            ", or set link.reference: measured in the cell (corrections count from the measured position)"
        )
    return f"SEND lacks {', '.join(missing)}; add them to SEND{option}"


def _received_objection(ethernet: Ethernet, axes: tuple[Axis, ...], relative: bool) -> str | None:
    corrections = _corrections(ethernet)
    names = [element.attribute for element in corrections]
    for axis in axes:
        found = names.count(axis.name)
        if found != 1:
            return (
                f"RECEIVE has {found} DOUBLE elements for {axis.name} ({axis.joint}); expected one like AK.A1"
            )
    for element in corrections:
        if element.hold is relative:
            return f"RECEIVE: {element.tag}.{element.attribute} has HOLDON {_HOLDING[relative]}"
    return None


def _length_objection(writer: ReplyWriter, axes: int) -> str | None:
    length = len(writer.write((-10000.0,) * axes, 10**19))
    if length <= LONGEST_REPLY:
        return None
    return (
        f"replies would have {length} bytes, a KRC accepts {LONGEST_REPLY}: declare fewer elements in RECEIVE"
    )


def _corrections(ethernet: Ethernet) -> list[Received]:
    return [one for one in ethernet.received if one.attribute in AXES and one.type == "DOUBLE"]
