"""What holds for all tests."""

import pytest

from armgate.integrity import compiled


@pytest.fixture(scope="session", autouse=True)
def _kernels_in_the_cache():
    """Compiles the gate's kernels once, so that no daemon that a test starts does it while the test waits."""
    if compiled.available():
        compiled.prepare()
