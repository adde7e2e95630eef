"""Commands on a recording: recover, replay, explain, report, audit and lag."""
