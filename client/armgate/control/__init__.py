"""Control laws: pure functions from the data that a controller has to the increment that it requests.

The package contains the camera law of Bjerkeng et al., "Active camera control with obstacle avoidance for
remote operations with industrial manipulators" (equation numbers in this package are that paper's), and the
parts that a follower needs around it. Nothing here reads a clock or a socket: time, positions and bounds are
arguments.

`law.py` and the modules that it uses are the readable form in numpy; `kernels.py` repeats their formulas for
numba, and `compiled.py` chooses between the two.
"""
