"""Surface geometry shared by several stages: lattices of depth, normals, planes."""
