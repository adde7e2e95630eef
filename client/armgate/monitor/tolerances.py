"""Tolerances of the monitor's rules; docs/monitor.md lists the reasons."""

DESCRIBED = 1e-7
"""Tolerance of described numbers, m, rad or relative: conversions of units and rotations round."""

CLEARANCE = 2e-5
"""Tolerance of a clearance, m; for a measured position its error times the lever is added."""

PAIR_SLACK = 3e-4
"""Total decrease allowed for a clearance that was violated at the start, m."""

DEEP_SLACK = 5e-3
"""Total decrease allowed for overlapping bodies, whose depth is not certified, m."""

JOINT = 1e-6
"""Tolerance of a joint limit for setpoints and stop ends, rad or m."""

JOINT_SLACK = 1.1e-4
"""Total increase allowed for the excess of a joint that was beyond its limit at the start, rad or m."""

STEP = 1e-7
"""Tolerance for the rounding of an increment, rad or m."""

RATE = 1e-3
"""Relative tolerance of increments and of their changes."""

END = 1e-5
"""Tolerance between the reported and the computed stop end, rad or m."""

STILL = 2e-6
"""Largest motion of a robot at rest in a tick, rad or m."""

REBASED = 3.0
"""A reset that moves the setpoint by more than this many measurement errors adopts a new position."""

MEASURED_TICKS = 8
"""Number of ticks over which the speed of measured positions is computed; one tick more is tolerated."""

STALE = 2.5
"""Age of the newest state, in periods, from which the position of a robot counts as unknown."""

DISTANCE = 1e-5
"""Tolerance of a reported distance above the computed one, m."""

CLOCK = 1e-9
"""Tolerance of times in lock-step, which are whole nanoseconds, s."""

PACE_TICKS = 64
PACE_TIME = 1.0
"""Smallest number of ticks and shortest time, s, of a block; its earliest tick counts as on time."""

PACE = 0.25
"""Tolerance of early ticks, as a share of a block."""

SILENCE = 1.0
"""Time without a state after which a robot counts as silent, s."""
