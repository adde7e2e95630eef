"""The cell as data: configuration, kinematics, bodies, motion bounds, and the gate's events."""
