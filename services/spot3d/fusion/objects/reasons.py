"""Why a candidate is no object: the reasons by which `Objects` counts what is left out."""

TOO_SELDOM = "seen too seldom"
"""In fewer keyframes than `views_min`: mostly fragments of one view. While the stream goes on, also in one update
only."""
MOSTLY_BACKGROUND = "background in most views"
"""Fewer than `object_share` of the keyframes that see it take it for an object."""
GONE = "no longer there"
"""The latest keyframes that look at where it was, as many as `views_min`, see what lies behind it."""
TOO_COLD = "too cold"
"""Its confidence is below eps, `heat_min`."""
TOO_LARGE = "too large"
"""Longer than eps_max, `size_max`."""
TOO_SMALL = "too small"
"""Narrower than eps_min, `size_min`, less eps_p, `plane_distance`, or of less than `volume_min`."""
TOO_THIN = "too thin"
"""Within the noise of a plane: thinner than eps_p, `plane_distance`."""

REASONS = (TOO_SELDOM, MOSTLY_BACKGROUND, GONE, TOO_COLD, TOO_LARGE, TOO_SMALL, TOO_THIN)
"""All of them."""
