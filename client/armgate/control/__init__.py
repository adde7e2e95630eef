"""Control laws: pure functions from a controller's knowledge to the increment that it requests.

The camera law of Bjerkeng et al., "Active camera control with obstacle avoidance for remote operations with
industrial manipulators" (equation numbers in this package are that paper's), and the parts that a follower
needs around it. Nothing here reads a clock or a socket: time, positions and bounds are arguments.
"""
