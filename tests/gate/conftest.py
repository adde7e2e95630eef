"""Gate tests run the compiled form, as users do; ARMGATE_NUMPY=1 runs them all in numpy."""

import os
import sys

if os.environ.get("ARMGATE_NUMPY"):
    sys.modules["numba"] = None  # as if it were not installed
