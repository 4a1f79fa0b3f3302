"""Clusters segments of different views into objects, by the share of the views that hold both in one segment.

After M. Yan et al., MaskClustering, CVPR 2024 (see `views`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.kernel import kernel

_UNDER_SEGMENTED = 0.5
"""A segment that this share of the views that see it divide, most of them, holds several objects, and supports nothing.
With 0.35, a laptop that four views in ten show as a screen and a keyboard was found neither whole nor in parts. From
0.45 to 0.6 the results are the same to one object in fifty; with 0.35 and 0.4 clutter has two in a hundred less."""
_OBSERVERS = (20, 15, 10, 8, 6, 5, 4, 3, 2)
"""How many views must see both to join, in turn. The most first: what is joined is seen by more."""
_AGREED = 0.6
"""Share of the views of two segments that must hold both in one: most, and a few more than can be chance. With 0.9,
what a fifth of the views tore in two was found neither whole nor in parts. With 0.5, 0.6, 0.7: detection 0.68, 0.72,
0.70 and F 97, 96, 95 on rendered desks; 0.53, 0.55, 0.53 and 93, 92, 87 on the same shaken by 10 mm; 0.91, 0.92, 0.93
and 97 on built-in clutter. Thirteen runs of redkitchen: 0.87 with 0.55 and 0.6, 0.85 with 0.7, and 89."""
_MOST = 0.5
"""Share of the views of two objects that hold both in one, from which the one that fewer views show is a part: most.
With 0.4 the results are the same, with 0.6 half as much is gained: on built-in clutter, with true and with shaken
poses, 0.03 in success rate and half of the boxes of no object, for 0.006 in IoU and one of 106 objects."""


class Statements(NamedTuple):
    """What frames say of n segments, but for each one's own frame, which observes it, within itself.

    frame: (n,) the frame of each segment; observed: (k, 2) rows and frames that see objects in them; within: (m, 2)
    rows of segments and of those of other frames that hold them; divided: (d,) rows, one for each frame that divides
    one; background: (b,) rows, one for each frame that sees no object in most of one.
    """

    frame: NDArray[np.int64]
    observed: NDArray[np.int64]
    within: NDArray[np.int64]
    divided: NDArray[np.int64]
    background: NDArray[np.int64]


def clusters_of(
    statements: Statements, views_min: int, object_share: float, join_parts: bool = True
) -> NDArray[np.int64]:
    """The cluster of each of n segments, (n,) int64; -1 for a segment of several objects.

    An object is shown by `views_min` frames, and seen as one by `object_share` of those that see it. join_parts: what
    most views hold in one with a larger object is a part of that (see `_whole_of`).
    """
    frame, observed, within, divided, background = statements
    count = len(frame)
    # A frame may see objects in segments, and have none of its own.
    frames = 1 + int(max(frame.max(initial=-1), observed[:, 1].max(initial=-1)))
    own = np.arange(count)
    observers = 1 + np.bincount(observed[:, 0], minlength=count)  # its own frame observes it as well
    under = np.bincount(divided, minlength=count) >= _UNDER_SEGMENTED * observers
    # A segment that spills over objects, or lies between them, is an object in few views: it holds only others like it.
    spilled = observers < object_share * (observers + np.bincount(background, minlength=count))
    # A frame does not separate what lies in its segment of several objects, and so says nothing of it.
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
    """The cluster of each cluster, (n,), with parts joined to their wholes.

    A cluster is a part of another if most views hold both in one, and more frames do so than show it by itself. pairs:
    as of `_pairs`; shown_by: (n,) frames that have segments of each cluster. Clusters that too few frames show for an
    object stay: they are errors of these rather than parts.
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
    places = rows.astype(np.int32), columns.astype(np.int32)  # the index type that products of matrices keep
    return _binary(csr_array((np.ones(len(rows), np.int32), places), shape))


def _binary(matrix: csr_array) -> csr_array:
    matrix.sum_duplicates()
    matrix.data[:] = 1
    return matrix


def _pairs(V: csr_array, C: csr_array, share: float) -> tuple[NDArray[np.int64], ...]:
    """Pairs of rows that enough of the frames that see both hold in one segment.

    Returns a, b, how many frames see both, how many segments hold both.
    """
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

    starts, columns, supporters: the sparse matrix of supporters by rows; words: each row's frames as bits.
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
