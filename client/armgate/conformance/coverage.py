"""Statements about the server that no case tries, each with the reason."""

UNOBSERVED = {
    "HEL-11": "the kit never starts a server anew",
    "CMD-11": "a link fails by the robot's doing, never by a client's",
    "STA-13": "the true distance needs a model of the bodies, which a black box has no part in",
    "LCK-12": "needs two runs of a server from its start, and a comparison of both",
    "SEC-8": "the door would close for the kit itself",
    "EVO-3": "speaks of later additions",
    "EVO-4": "speaks of later additions",
    "EVO-6": "speaks of later versions",
}
"""By id. Few, and none that a wire shows: the tests bound this table."""
