"""Which segments of different views are one object: as many views as see both have them in one segment.

After M. Yan et al., MaskClustering, CVPR 2024 (see `views`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.kernel import kernel

_UNDER_SEGMENTED = 0.5
"""A segment that this share of the views that see it divide, most of them, holds several objects: it supports nothing.
Where it was 0.35, a laptop that four views in ten show as a screen and a keyboard was found neither whole nor in parts.
From 0.45 to 0.6 the results are the same to an object in fifty; with 0.35 and 0.4 clutter has two in a hundred less."""
_OBSERVERS = (20, 15, 10, 8, 6, 5, 4, 3, 2)
"""What most views have seen joins first: later, what is joined is seen by more."""
_AGREED = 0.6
"""Share of the views of two segments that must have them in one: most, and a few more than can be chance. Where it was
0.9, what a fifth of the views tore in two was found neither whole nor in parts. Detection, and F, with 0.5, 0.6, 0.7:
rendered desks 0.68, 0.72, 0.70 and 97, 96, 95; the same shaken by 10 mm 0.53, 0.55, 0.53 and 93, 92, 87; built-in
clutter 0.91, 0.92, 0.93 and 97; thirteen runs of redkitchen with 0.55 and 0.6 0.87, with 0.7 0.85, and 89."""
_MOST = 0.5
"""Share of the views of two objects that have them in one, from which the one that fewer views show is a part: most.
With 0.4 the results are the same, with 0.6 half as much is gained: on built-in clutter 0.03 in success rate, of true
poses and of shaken ones, and half of the boxes that are no object, for 0.006 in IoU and one of 106 objects."""


class Statements(NamedTuple):
    """What frames say of n segments. A segment is observed by its own frame, and within itself: that is left out.

    frame: (n,) the frame of each segment; observed: (k, 2) rows and frames that see objects in them; within: (m, 2)
    rows of segments and of those of other frames that hold them; divided: (d,) rows, one for each frame that divides
    one; background: (b,) rows, one for each frame that sees no object in most of one.
    """

    frame: NDArray[np.int64]
    observed: NDArray[np.int64]
    within: NDArray[np.int64]
    divided: NDArray[np.int64]
    background: NDArray[np.int64]


def clusters_of(said: Statements, views_min: int, object_share: float, join_parts: bool = True) -> NDArray[np.int64]:
    """The cluster of each of n segments, (n,) int64; -1 for what holds several objects.

    An object is shown by `views_min` frames, and seen as one by `object_share` of those that see it. join_parts: what
    most views have in one with a larger object is a part of that (see `_whole_of`).
    """
    frame, observed, within, divided, background = said
    count = len(frame)
    # A frame may see objects in segments, and have none of its own.
    frames = 1 + int(max(frame.max(initial=-1), observed[:, 1].max(initial=-1)))
    own = np.arange(count)
    observers = 1 + np.bincount(observed[:, 0], minlength=count)  # its own frame observes it as well
    under = np.bincount(divided, minlength=count) >= _UNDER_SEGMENTED * observers
    # What spills over things and what is between them is seen as an object by few: it holds none but its like.
    spilled = observers < object_share * (observers + np.bincount(background, minlength=count))
    # What lies in a segment of several objects is not told apart by its frame, which then says nothing of it.
    misled = under[within[:, 1]] | (spilled[within[:, 1]] & ~spilled[within[:, 0]])
    silent = np.unique(within[misled, 0] * frames + frame[within[misled, 1]])
    observed = observed[~np.isin(observed[:, 0] * frames + observed[:, 1], silent)]
    within = within[~misled]
    V = _incidence(np.append(observed[:, 0], own), np.append(observed[:, 1], frame), (count, frames))
    C = _incidence(np.append(within[:, 0], own), np.append(within[:, 1], own), (count, count))

    kept = np.flatnonzero(~under)
    cluster = np.arange(len(kept))
    V, C = V[kept], C[kept]
    a, b, seen_by, _ = _pairs(V, C, _AGREED)
    for least in _OBSERVERS:
        while (agreed := seen_by >= least).any():
            shape = (V.shape[0], V.shape[0])
            joined = csr_array((np.ones(int(agreed.sum())), (a[agreed], b[agreed])), shape)
            groups, number = connected_components(joined, directed=False)
            cluster = number[cluster]
            gather = _incidence(number, np.arange(len(number)), (groups, len(number)))
            V, C = _binary(gather @ V), _binary(gather @ C)
            a, b, seen_by, _ = _pairs(V, C, _AGREED)
    found = np.full(count, -1, np.int64)
    if not join_parts:
        found[kept] = cluster
        return found
    shown_by = np.bincount(np.unique(cluster * frames + frame[kept]) // max(frames, 1), minlength=V.shape[0])
    found[kept] = _whole_of(_pairs(V, C, _MOST), shown_by, views_min)[cluster]
    return found


def _whole_of(pairs: tuple[NDArray[np.int64], ...], shown_by: NDArray[np.int64], views_min: int) -> NDArray[np.int64]:
    """The cluster of each cluster, (n,), anew: an object that most views have in one with another is a part of it,
    where more frames do so than show it by itself.

    pairs: as of `_pairs`; shown_by: (n,) frames that have segments of each cluster. What too few show for an object
    stays as it is: it is rather an error of these than a part.
    """
    a, b, seen_by, supporters = pairs
    part, whole = np.where(shown_by[a] <= shown_by[b], (a, b), (b, a))
    own = shown_by[part]
    is_part = (own >= views_min) & (own < supporters) & (own < shown_by[whole])
    part, whole, share = part[is_part], whole[is_part], (supporters / seen_by)[is_part]
    order = np.lexsort((whole, -shown_by[whole], -share, part))
    part, first = np.unique(part[order], return_index=True)
    parent = np.arange(len(shown_by))
    parent[part] = whole[order][first]
    while (parent != parent[parent]).any():  # ends: a whole is shown by more frames than its part
        parent = parent[parent]
    return np.unique(parent, return_inverse=True)[1].astype(np.int64)


def _incidence(rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> csr_array:
    places = rows.astype(np.int32), columns.astype(np.int32)  # products of matrices keep to these
    return _binary(csr_array((np.ones(len(rows), np.int32), places), shape))


def _binary(matrix: csr_array) -> csr_array:
    matrix.sum_duplicates()
    matrix.data[:] = 1
    return matrix


def _pairs(V: csr_array, C: csr_array, share: float) -> tuple[NDArray[np.int64], ...]:
    """Pairs of rows that enough frames have in one segment, of those that see both: a, b, how many see both, and how
    many have them in one."""
    both = C @ C.T
    words = np.zeros((V.shape[0], -(-V.shape[1] // 64)), np.uint64)
    words.view(np.uint8)[:, : -(-V.shape[1] // 8)] = np.packbits(V.toarray().astype(np.bool_), axis=1)
    found = np.empty((4, both.nnz), np.int64)
    starts, columns = (part.astype(np.int32, copy=False) for part in (both.indptr, both.indices))
    return tuple(found[:, : _compare(starts, columns, both.data, words, share, found)])


@kernel("i8(i4[::1], i4[::1], i4[::1], u8[:,::1], f8, i8[:,::1])")
def _compare(
    starts: NDArray[np.int32],
    columns: NDArray[np.int32],
    supporters: NDArray[np.int32],
    words: NDArray[np.uint64],
    share: float,
    found: NDArray[np.int64],
) -> int:
    """Write the pairs of `_pairs` to (4, .) `found`; returns their count.

    starts, columns, supporters: the matrix of supporters by rows; words: each row's frames as bits.
    """
    count = 0
    for a in range(len(starts) - 1):
        for k in range(starts[a], starts[a + 1]):
            b = columns[k]
            if b <= a:
                continue
            seen_by = 0
            for word in range(words.shape[1]):
                bits = words[a, word] & words[b, word]
                while bits:
                    bits &= bits - np.uint64(1)
                    seen_by += 1
            if supporters[k] >= share * seen_by:
                found[0, count], found[1, count] = a, b
                found[2, count], found[3, count] = seen_by, supporters[k]
                count += 1
    return count
