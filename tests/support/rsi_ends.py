"""Final checks of tests of the RSI link: at rest, ready again after a reset, or without motion."""

SLOW = (0.0012, -0.0006, 0.0006, 0.0, 0.0, 0.0)
"""About 11 % of the largest speed at 4 ms: slow enough for the drives to stop within a cycle."""


def gap(rig):
    """Return the largest difference between the setpoints of the gate and of the KRC."""
    setpoint = rig.gate.view("R").setpoint
    return max(abs(a - b) for a, b in zip(setpoint, rig.krc_setpoint, strict=True))


def at_rest(rig, cycles=120):
    rig.cycles(cycles)
    assert rig.link.remaining == 0
    assert gap(rig) < 1e-7
    return rig


def rearm(rig):
    """Reset the stops as an operator; check that the link becomes ready and the robot can be moved."""
    rig.cycles(120)
    assert rig.link.state.value != "ready"
    assert rig.reset(), rig.gate.view("R")
    rig.until_ready()
    rig.take_lease()
    before = rig.krc_setpoint
    rig.drive(20, *SLOW)
    at_rest(rig)
    assert rig.krc_setpoint[0] - before[0] > 15 * SLOW[0]


def start_anew(rig):
    """Acknowledge and start the program at the KRC, then call `rearm`."""
    rig.operate("reset")
    rig.operate("start")
    rearm(rig)


def nothing_moves(rig, cycles=100):
    """Check that every command is refused and the setpoint of the KRC stays the same."""
    before = rig.krc_setpoint
    for _ in range(cycles):
        verdict = rig.command(*SLOW)
        assert verdict.outcome == "refused"
        rig.cycle()
    assert rig.krc_setpoint == before
