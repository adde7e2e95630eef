"""Ends of tests of the RSI link: at rest, armed again, or with nothing that moves."""

SLOW = (0.0012, -0.0006, 0.0006, 0.0, 0.0, 0.0)
"""About 11 % of the speed at 4 ms: a cycle that the KRC holds is no fault of its drives'."""


def gap(rig):
    """Between where the gate believes the robot is commanded to be and where it is."""
    setpoint = rig.gate.view("R").setpoint
    return max(abs(a - b) for a, b in zip(setpoint, rig.krc_setpoint, strict=True))


def at_rest(rig, cycles=120):
    rig.cycles(cycles)
    assert rig.link.remaining == 0
    assert gap(rig) < 1e-7
    return rig


def rearm(rig):
    """An operator resets; the link is ready again, and the robot can be moved."""
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
    """The KRC's operator acknowledges and starts its program; then an operator resets, as `rearm`."""
    rig.operate("reset")
    rig.operate("start")
    rearm(rig)


def nothing_moves(rig, cycles=100):
    """Whatever is commanded: the KRC's setpoint stays."""
    before = rig.krc_setpoint
    for _ in range(cycles):
        verdict = rig.command(*SLOW)
        assert verdict.outcome == "refused"
        rig.cycle()
    assert rig.krc_setpoint == before
