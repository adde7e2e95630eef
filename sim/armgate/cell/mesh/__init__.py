"""Triangle meshes: search and reading of files (``formats``), and ``decomposition`` into convex bodies.

The convex bodies of a mesh together contain it and everything that it encloses. The package needs the
libraries of the extra ``cell``.
"""
