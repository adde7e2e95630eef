"""Pictures of manipulability ellipsoids along a motion."""
