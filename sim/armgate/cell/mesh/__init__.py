"""Triangle meshes, cut into convex bodies that together contain them; needs the libraries of the cell."""
