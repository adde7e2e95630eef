"""Convex decomposition: a mesh is cut along planes, and the hull of each piece becomes a convex body."""
