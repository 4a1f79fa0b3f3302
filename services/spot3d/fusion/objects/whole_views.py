"""Views that hold in one segment what others have in pieces: a lamp with its shade in view, which others cut off."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.objects.balance import Numbers


def wholes(
    things: Iterable[Numbers], observations: NDArray[np.int32], cluster: NDArray[np.int64]
) -> dict[Numbers, NDArray[np.int64]]:
    """For each object of several pieces, the rows of the segments that hold several of these and none of other objects.

    things: the pieces of each, which are numbers of clusters; observations: see `SegmentGraph`; cluster: (n,) of
    each segment.
    """
    things = list(things)
    several = [thing for thing in things if len(thing) > 1]
    if not several:
        return {}
    observations = observations[observations[:, 3] >= 0]
    pieces, holder = cluster[observations[:, 0]], observations[:, 3]
    # First select the observations of segments in holders of any of these pieces: sorting the rest takes long.
    asked = np.zeros(len(cluster), np.bool_)
    asked[holder[np.isin(pieces, np.concatenate(several))]] = True
    about = asked[holder] & np.isin(pieces, np.concatenate(things))
    # Each pair of a holder and a piece once; pairs are sorted far faster as single numbers.
    numbers = int(cluster.max()) + 1
    holder, pieces = np.divmod(np.unique(holder[about].astype(np.int64) * numbers + pieces[about]), numbers)
    found = {}
    for thing in several:
        own = np.isin(pieces, thing)
        count, others = (np.bincount(holder[which], minlength=len(cluster)) for which in (own, ~own))
        found[thing] = np.flatnonzero((count > 1) & (others == 0))
    return found
