"""Short texts of events and outputs of the gate for the trace; equal events have equal texts."""

from armgate import events as e


def brief(item: e.GateEvent | e.GateOutput) -> str:
    """Return a short text with the numbers in which a difference would show."""
    match item:
        case e.Tick():
            return f"tick {item.robot} {item.tick} {item.time} {item.q} {item.increment} {item.index}"
        case e.Verdict():
            return f"verdict {item.robot} {item.seq} {item.outcome} {item.beta} {item.dq}"
        case e.Plan():
            return f"plan {item.robot} {item.key.target} {len(item.increments)} {item.increments[0]}"
        case e.PlanAnswer():
            return f"answer {item.robot} {item.key.target} {item.accepted} {item.reason}"
        case e.Command():
            return f"command {item.robot} {item.fence} {item.seq} {item.based_on} {item.dq} {item.holder}"
        case _:
            return repr(item)
