"""Unguided search: vectors with changed, removed and repeated bytes, also joined."""

import traceback

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tools.fuzz.corpus import corpus
from tools.fuzz.target import ROLES, check

_BATCH = 10_000
"""Inputs of one search: hypothesis stores all inputs it has tried, which must not exhaust the memory."""


def inputs() -> st.SearchStrategy[bytes]:
    """Return a strategy for mutated vectors."""
    vectors = st.sampled_from(corpus())
    changes = st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(max_size=4), st.integers(0, 4)), max_size=4)
    changed = st.builds(_changed, vectors, changes)
    joined = st.builds(lambda one, other: one + other[1:], changed, changed)
    role = st.integers(0, len(ROLES) - 1).map(lambda number: bytes([number]))
    return changed | joined | st.builds(bytes.__add__, role, st.binary(max_size=200))


def _changed(data: bytes, changes: list[tuple[float, bytes, int]]) -> bytes:
    for where, new, gone in changes:
        at = 1 + int(where * (len(data) - 1))
        data = data[:at] + new + data[at + gone :]
    return data


def search(runs: int) -> str | None:
    """Return the first failure with its input; None if there is none."""
    for first in range(0, runs, _BATCH):
        if (broken := _batch(min(_BATCH, runs - first))) is not None:
            return broken
    return None


def _batch(runs: int) -> str | None:
    @settings(
        max_examples=runs,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],  # report a finding at once, without shrinking it
        print_blob=False,
    )
    @given(inputs())
    def holds(data: bytes) -> None:
        check(data)

    try:
        holds()
    except Exception:
        return traceback.format_exc()
    return None
