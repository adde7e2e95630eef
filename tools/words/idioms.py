"""Idioms that readers have to decode, each with the plain words to use instead.

The table holds only what a machine finds without false alarms; docs/glossary.md is longer.
"""

import re
from collections.abc import Iterator

IDIOMS: dict[str, str] = {
    r"onlookers?": "observer",
    r"look(?:s|ing|ed)? on(?! the\b)": "observe",
    r"(?:made?|makes|making)(?: \w+)? whole": "recover",
    r"judge[sd]? again": "replay",
    r"say and draw": "explain",
    r"(?<!there )is none": "is missing, is not …, is zero",
    r"none is": "there is no …; if no … is",
    r"(?:is|are|was|were) no more(?! than)": "no longer exists",
    r"nobody|somebody|anybody|who(?:m)?ever": "name the actor: client, operator, daemon, user",
    r"those who|all who": "name the actor: clients, operators, observers",
    r"tells?(?! (?:\S+ ){0,3}(?:apart|from))|told(?! (?:apart|from))": "send, return, report, log",
    r"says|said": "state, report, log, define",
    r"hears": "receive",
    r"bears?": "have, carry, accept",
    r"knows? of": "have, hold, contain",
    r"joints that are over": "redundant joints",
    r"befalls?": "affect",
    r"comes? later than": "be delayed by more than",
    r"lets? through|turned away": "admit, limit, refuse",
    r"cuts? off": "close, abort, drop (a connection); truncate (a file)",
    r"g[ia]ven? back|gives? back": "release",
    r"t(?:aken?|ook) back|takes back": "revoke, withdraw",
    r"lets? go": "release",
    r"what stands": "surroundings; or name the thing",
    r"to and fro": "back and forth; oscillate",
    r"patience(?![:=])": "timeout",  # the SDK's parameter keeps its name
    r"wish(?:es|ed)?": "command, request, requested",
    r"nearness": "clearance, distance",
    r"brakes? on": "continue to brake",
    r"once more": "again",
    r"to be had": "available",
    r"neither(?=[.;])": "repeat the verb",
    r"lest|whence|thence|whither|whereof|thereof|nought": "plain words",
}

_IDIOM = re.compile("|".join(rf"(?P<i{n}>\b(?:{pattern})\b)" for n, pattern in enumerate(IDIOMS)))
_HINTS = list(IDIOMS.values())
_NAME = re.compile(
    r"(?:^|_)(onlookers?|nobody|somebody|anybody|who(?:m)?ever|tells?|told|says?|said|hears?|heard|bears?|hush|heed)"
    r"(?=_|$)"
)


def idioms(text: str) -> Iterator[tuple[int, str]]:
    """Yield offset and description of each idiom in a text."""
    lower = re.sub(r"\b(?!None\b)[A-Z](?=[a-z])", lambda first: first[0].lower(), text)
    for match in _IDIOM.finditer(lower):
        assert match.lastgroup is not None
        hint = _HINTS[int(match.lastgroup[1:])]
        yield match.start(), f"“{match[0]}”: {hint}"


def riddle(name: str) -> str | None:
    """Return the part of a function's name that has to be decoded, or None; Python itself has ``tell``."""
    match = _NAME.search(name.lower())
    return match[1] if match and name != "tell" else None
