"""eps_min and eps_max of the paper: which sizes an object may have, the same for every stage unless a stage is told."""

SIZE_MIN = 0.02
"""eps_min: an object is at least this large, metres."""
SIZE_MAX = 1.0
"""eps_max: an object is at most this large, metres."""
