"""These tests run the form that users get: the compiled one. ARMGATE_NUMPY=1 runs all in the readable one."""

import os
import sys

if os.environ.get("ARMGATE_NUMPY"):
    sys.modules["numba"] = None  # as where it is not installed
