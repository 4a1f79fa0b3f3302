"""Views that have in one segment what others have in pieces: of a lamp with its shade in view, which others cut off."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.objects.balance import Numbers


def wholes(
    things: Iterable[Numbers], said: NDArray[np.int32], cluster: NDArray[np.int64]
) -> dict[Numbers, NDArray[np.int64]]:
    """For each thing of several pieces, the rows of the segments that hold some of these and nothing of other things.

    things: the pieces of each, which are numbers of clusters; said: see `SegmentGraph`; cluster: (n,) of each segment.
    """
    things = list(things)
    pieces, holder = cluster[said[:, 0]], said[:, 3]
    known = (holder >= 0) & np.isin(pieces, [piece for thing in things for piece in thing])
    held = np.unique(np.column_stack((holder, pieces))[known], axis=0)
    found = {}
    for thing in (thing for thing in things if len(thing) > 1):
        own = np.isin(held[:, 1], thing)
        count, others = (np.bincount(held[which, 0], minlength=len(cluster)) for which in (own, ~own))
        found[thing] = np.flatnonzero((count > 1) & (others == 0))
    return found
