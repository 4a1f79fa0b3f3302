"""What several stages know of surfaces: lattices of depth, normals, planes."""
