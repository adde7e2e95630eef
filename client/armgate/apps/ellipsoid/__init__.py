"""``armgate ellipsoid``: pictures of manipulability ellipsoids along a motion."""
