"""spot3d: 3D boxes around unknown objects from a live RGB-D camera (Pahwa et al.'s online method)."""

__version__ = "0.1.0"
