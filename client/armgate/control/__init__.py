"""Control laws, pure: what increment a controller asks for, given what it knows.

The camera law of Bjerkeng et al., "Active camera control with obstacle avoidance for remote operations with
industrial manipulators" (equation numbers in this package are that paper's), and what a follower needs
around it. Nothing here reads a clock or a socket: time, positions and bounds come in as arguments.
"""
