"""What the monitor allows beyond the rules of the configuration; docs/monitor.md lists the reasons."""

DESCRIBED = 1e-7
"""Described numbers may differ by this much, m, rad or relative: conversions of units and rotations round."""

CLEARANCE = 2e-5
"""A margin may be missed by this much, m; a measured position adds its error, times the lever."""

PAIR_SLACK = 3e-4
"""A margin that was violated at the start may get worse by this much in all, m."""

DEEP_SLACK = 5e-3
"""The same for bodies that overlap, whose depth is not certified, m."""

JOINT = 1e-6
"""A setpoint or end may be beyond a limit by this much, rad or m."""

JOINT_SLACK = 1.1e-4
"""A joint that was beyond its limit at the start may fall back by this much in all, rad or m."""

STEP = 1e-7
"""Rounding of an increment, rad or m."""

RATE = 1e-3
"""Increments and their changes may be larger by this share."""

END = 1e-5
"""A reported end of a stop may differ from the computed one by this much, rad or m."""

STILL = 2e-6
"""A robot at rest moves less than this in a tick, rad or m."""

REBASED = 3.0
"""A setpoint that a reset moves by more than this many errors of the measurement was moved on purpose."""

MEASURED_TICKS = 8
"""The speed of measured positions is taken over so many ticks, and may be one tick's share larger."""

STALE = 2.5
"""A robot whose newest state is older than so many of its periods may be elsewhere: states are missing."""

DISTANCE = 1e-5
"""A reported distance may be above the computed one by this much, m."""

CLOCK = 1e-9
"""In lock-step times are whole nanoseconds; their rounding, s."""

PACE_TICKS = 64
PACE_TIME = 1.0
"""The earliest of so many ticks, in so much time at least, s, is on time."""

PACE = 0.25
"""Ticks may be ahead of time by this share of such a block."""

SILENCE = 1.0
"""A robot whose states do not come for this long is silent, s."""
