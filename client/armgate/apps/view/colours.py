"""Colours of robots, surroundings and states."""

RGB = tuple[int, int, int]

ARM: RGB = (238, 98, 16)
STRUCTURE: RGB = (78, 88, 104)
DARK: RGB = (40, 42, 48)
BLACK: RGB = (58, 60, 66)
HAND: RGB = (70, 74, 84)
TOOL: RGB = (20, 205, 130)
FLOOR: RGB = (168, 173, 180)
EDGE: RGB = (28, 30, 34)
BACKGROUND: RGB = (222, 229, 236)

_SURROUNDINGS: tuple[tuple[str, RGB], ...] = (
    ("floor", FLOOR),
    ("wheel", (196, 40, 38)),
    ("stem", (120, 124, 130)),
    ("valve", (60, 92, 140)),
    ("pipe", (112, 158, 168)),
    ("tank", (186, 194, 204)),
    ("frame", (228, 186, 60)),
)
_OTHER: RGB = (140, 150, 165)

STATES: dict[str, RGB] = {
    "stop": (214, 48, 49),
    "near": (225, 140, 0),
    "clear": (46, 160, 67),
}


def surrounding(name: str) -> RGB:
    """Return the colour of a body of the surroundings."""
    return next((colour for word, colour in _SURROUNDINGS if word in name), _OTHER)


def margin(distance: float, limit: float) -> RGB:
    """Return the colour of a clearance: from red at the limit to green at four times the limit."""
    share = min(max((distance - limit) / max(3.0 * limit, 1e-6), 0.0), 1.0)
    low, high = (STATES["stop"], STATES["near"]) if share < 0.5 else (STATES["near"], STATES["clear"])
    t = 2.0 * share if share < 0.5 else 2.0 * share - 1.0
    r, g, b = (round(a + t * (z - a)) for a, z in zip(low, high, strict=True))
    return r, g, b
