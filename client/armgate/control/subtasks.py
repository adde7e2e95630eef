"""Sub-tasks in the null space that concern the camera alone: view distance (14) and roll (15)."""

from __future__ import annotations

from math import asin, atan2, hypot

from armgate.control.vectors import V3


def distance_pull(distance: float, wanted: float, k: float) -> float:
    """Return the factor of ∂‖x − p‖/∂q that gives F_d of (14): k (d_r − ‖x − p‖), rad/s per (m/rad).

    With the ray r̂ = (p − x)/‖p − x‖, −J_vᵀ r̂ is that gradient, so (14) is −∇ of ½ k (d_r − ‖x − p‖)²: it is
    zero at the wanted distance and pulls the camera in when it is too far.

    Args:
        distance: ‖x − p‖, m.
        wanted: d_r, m.
        k: gain.
    """
    return k * (wanted - distance)


def roll_angle(e1: V3, e2: V3) -> float:
    """Return φ = Atan2(R_32, R_31) of (15), rad: roll of the camera's up-vector e1 about the view axis."""
    return atan2(e2[2], e1[2])


def roll_rate(e1: V3, e2: V3, spin: float, fade: tuple[float, float], k_c: float) -> float:
    """Return the speed of the last joint that turns the camera upright, (15), rad/s.

    Args:
        e1: the camera's up-vector, world axes.
        e2: the camera's second axis.
        spin: ∂φ/∂q of the last joint, −(axis · e3). It is 1 if the joint's axis is opposite to the view axis,
            as for A6 of a KR16 with a camera that points along the flange; then the printed sign of (15)
            holds. It is −1 if the axes are parallel.
        fade: angles of the view axis from the vertical, rad, between which the control fades in: with a
            vertical view there is no "up" in the picture, and near it a small motion changes φ fast.
        k_c: gain.
    """
    off_vertical = asin(min(hypot(e1[2], e2[2]), 1.0))
    share = (off_vertical - fade[0]) / (fade[1] - fade[0])
    share = min(max(share, 0.0), 1.0)
    smooth = share * share * (3.0 - 2.0 * share)
    return -k_c * spin * smooth * roll_angle(e1, e2)
