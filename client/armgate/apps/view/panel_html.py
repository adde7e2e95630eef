"""HTML of the panel's state blocks; all text that came over the network is escaped."""

import math
from collections.abc import Sequence
from html import escape

from armgate.apps.view import colours
from armgate.client import Entry, Joint, RobotDescription

NONE_YET = "—"


def badge(text: str, colour: colours.RGB) -> str:
    """Return a word on a coloured background."""
    return (
        f'<span style="background:rgb{colour};color:#fff;border-radius:4px;padding:1px 7px;'
        f'font-weight:600;white-space:nowrap">{escape(text)}</span>'
    )


def condition(entry: Entry) -> tuple[str, colours.RGB]:
    """Return a robot's state in one or two words, and its colour."""
    if entry.stops:
        return f"stopped ({', '.join(map(str, entry.stops))})", colours.STATES["stop"]
    if entry.link in ("lost", "faulted"):
        return f"link {entry.link}", colours.STATES["stop"]
    if entry.link == "waiting":
        return "link waiting", colours.STATES["near"]
    return ("driven", colours.STATES["clear"]) if entry.holder else ("free", (110, 118, 128))


def verdict(entry: Entry) -> str:
    """Return the last verdict in words."""
    last = entry.verdict
    if last is None:
        return "no command yet"
    why = f": {last.text}" if last.text else f" ({last.cause})" if last.cause else ""
    return f"{last.outcome}{why}"


def robot_html(robot: RobotDescription, entry: Entry) -> str:
    """Return the block of one robot: state, holder, verdict, clearance, joints."""
    word, colour = condition(entry)
    least = NONE_YET if entry.least_clearance is None else f"{1000 * entry.least_clearance:.0f} mm"
    last = verdict(entry)
    rows = "".join(bar(joint, value) for joint, value in zip(robot.joints, entry.q or (), strict=False))
    return (
        f'<div style="{_BLOCK}"><div style="display:flex;gap:8px;align-items:center">'
        f'<b style="font-size:14px">{escape(robot.name)}</b>'
        f"{badge(word, colour)}"
        f'<span style="{_QUIET}">{escape(entry.holder or "no lease")}</span></div>'
        f'<div style="{_TWO_LINES}" title="{escape(last, quote=True)}">{escape(last)}</div>'
        f'<div style="{_QUIET}">smallest clearance so far {least}</div>{rows}</div>'
    )


_BLOCK = "font-size:12px;line-height:1.5;margin:2px 10px 10px"
_TWO_LINES = "max-height:36px;overflow:hidden"
_QUIET = "color:#68707a"


def bar(joint: Joint, value: float) -> str:
    """Return the bar of one joint between its limits; amber within a tenth of its range of a limit."""
    span = joint.upper - joint.lower
    share = min(max((value - joint.lower) / span, 0.0), 1.0) if span > 0.0 else 0.5
    colour = colours.STATES["near"] if min(share, 1.0 - share) < 0.1 else (70, 120, 190)
    limits = f"{shown(joint, joint.lower)} to {shown(joint, joint.upper)}"
    return (
        f'<div style="display:flex;align-items:center;gap:6px;height:15px" title="{limits}">'
        f'<span style="width:24px">{escape(joint.name)}</span><span style="{_TRACK}">'
        f'<span style="{_KNOB}left:{100 * share:.1f}%;background:rgb{colour}"></span></span>'
        f'<span style="{_NUMBER}">{shown(joint, value)}</span></div>'
    )


_TRACK = "position:relative;flex:1;height:5px;border-radius:3px;background:#d5dae0"
_KNOB = "position:absolute;top:-3px;width:4px;height:11px;margin-left:-2px;border-radius:2px;"
_NUMBER = "width:62px;text-align:right;font-variant-numeric:tabular-nums"


def shown(joint: Joint, value: float) -> str:
    """Return a joint's value in degrees or metres."""
    return f"{math.degrees(value):.1f}°" if joint.unit == "rad" else f"{value:.3f} m"


def banner(text: str, colour: colours.RGB) -> str:
    """Return a conspicuous line."""
    return (
        f'<div style="margin:4px 10px;padding:5px 10px;border-radius:5px;background:rgb{colour};color:#fff;'
        f'font-size:12px">{escape(text)}</div>'
    )


def note(warnings: Sequence[str]) -> str:
    """Return the daemon's warnings in small print."""
    lines = "".join(f"<div>{escape(text)}</div>" for text in warnings)
    return (
        f'<div style="margin:0 12px;font-size:11px;color:rgb{colours.STATES["near"]}">{lines}</div>'
        if lines
        else ""
    )
