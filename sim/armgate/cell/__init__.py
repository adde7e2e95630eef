"""Model of the cell: configuration, kinematics, bodies, pairs and motion bounds."""
