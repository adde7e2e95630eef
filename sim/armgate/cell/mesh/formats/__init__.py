"""Readers of mesh files, one for each format: STL, OBJ, PLY and OFF."""
