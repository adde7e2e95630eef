"""Contents of ``info``: verdicts, clearances and measures of a step."""

from collections.abc import Sequence
from typing import Any

from armgate.env.transition import ArmState, Transition
from armgate.protocol.messages import Verdict

_WORST = {"admitted": 0, "limited": 1, "refused": 2}


def info_of(transition: Transition, robots: Sequence[str]) -> dict[str, Any]:
    """Return the info of a step.

    ========================  ================================================================================
    ``time``                  virtual time, s
    ``outcome``               worst outcome of the step: ``admitted``, ``limited`` or ``refused``
    ``beta``                  smallest β of the step, 1 if all increments were admitted
    ``reasons``, ``causes``   reasons of the gate in words, and names of the checks that applied
    ``clearance``             smallest reported distance of a robot of the agent, m
    ``margin``                the same, less the distance to be kept, m
    ``robots``                the same entries for each robot of the agent, and ``q`` in rad or m
    ``measures``              measures of the task
    ``programs``              outcomes of the programs of other robots in words; "" while one runs
    ========================  ================================================================================

    Args:
        transition: The step.
        robots: Robots of the agent.
    """
    arms = [transition.arms[robot] for robot in robots]
    return {
        "time": transition.time,
        **_verdict(transition.verdicts),
        **_distances(arms),
        "robots": {
            arm.robot: {
                **_verdict([verdict for verdict in transition.verdicts if verdict.robot == arm.robot]),
                **_distances([arm]),
                "q": arm.q.copy(),
                "setpoint": arm.setpoint.copy(),
            }
            for arm in arms
        },
        "measures": dict(transition.measures),
        "programs": dict(transition.programs),
    }


def _verdict(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    worst = max((verdict.outcome for verdict in verdicts), key=_WORST.__getitem__, default="admitted")
    reasons = [reason for verdict in verdicts for reason in verdict.reasons]
    return {
        "outcome": worst,
        "beta": min((verdict.beta for verdict in verdicts), default=1.0),
        "reasons": tuple(reason.text for reason in reasons),
        "causes": tuple(reason.cause for reason in reasons),
    }


def _distances(arms: Sequence[ArmState]) -> dict[str, float]:
    return {
        "clearance": min(arm.clearance for arm in arms),
        "margin": min(arm.margin for arm in arms),
    }
