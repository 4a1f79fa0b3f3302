"""Tables from which a window is scored without reading its pixels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.proposals.groups import EdgeGroups


class WindowIndex(NamedTuple):
    """Tables of n groups, e grouped pixels and k affinities; indices are unsigned, which spares a test for < 0.

    sums: (h + 1, w + 1, 2) float32, integral images of the groups' magnitudes, each at its group's anchor,
    and of the grouped pixels' magnitudes.
    norm: (h + w + 1,) float32, 1 / ((width + height) / 2)^kappa by width + height.
    starts: (h + 1, w + 1, 2) uint32, place in `lines` of the first grouped pixel at or after (y, x) along its
    row and along its column.
    lines: (2, e) uint32, the grouped pixels' groups row by row and column by column.
    anchor: (n, 2) int32, x and y of the pixel that stands for the group's place. magnitude: (n,) float32.
    first: (n + 1,) uint32, start of each group's row in neighbour: (k,) uint32 and affinity: (k,) float32,
    strongest first.
    Working memory: met: (n + 1,) int32, the last window that met the group, at the end the count of windows; queue:
    (n + 1,) uint32, groups whose neighbours are to be weighted; waits: (n,) uint8, whether the group is one of them;
    removed: (n,) float32, 1 - the group's weight in that window.
    """

    sums: NDArray[np.float32]
    norm: NDArray[np.float32]
    starts: NDArray[np.uint32]
    lines: NDArray[np.uint32]
    anchor: NDArray[np.int32]
    magnitude: NDArray[np.float32]
    first: NDArray[np.uint32]
    neighbour: NDArray[np.uint32]
    affinity: NDArray[np.float32]
    met: NDArray[np.int32]
    queue: NDArray[np.uint32]
    waits: NDArray[np.uint8]
    removed: NDArray[np.float32]


def index_windows(magnitude: NDArray[np.float32], groups: EdgeGroups, kappa: float) -> WindowIndex:
    """Index of an edge map (h, w) float32 and its groups for scoring with the size exponent kappa."""
    h, w = magnitude.shape
    sides = np.maximum(np.arange(h + w + 1, dtype=np.float32), 1)
    norm = ((sides / 2) ** np.float32(-kappa)).astype(np.float32)
    sums, starts = np.empty((h + 1, w + 1, 2), np.float32), np.empty((h + 1, w + 1, 2), np.uint32)
    sums[0], sums[:, 0] = 0, 0
    in_column = np.count_nonzero(groups.label >= 0, axis=0)
    column = np.cumsum(in_column) - in_column
    lines = np.empty((2, in_column.sum()), np.uint32)
    _build_tables(
        np.ascontiguousarray(magnitude), groups.label, groups.magnitude, groups.anchor, column, sums, starts, lines
    )
    starts[:h, w, 1], starts[h, :w, 1] = 0, column
    starts[h, :, 0], starts[h, w, 1] = lines.shape[1], 0
    n = groups.magnitude.size
    return WindowIndex(
        sums,
        norm,
        starts,
        lines,
        groups.anchor,
        groups.magnitude,
        groups.first.astype(np.uint32),
        groups.neighbour.astype(np.uint32),
        groups.affinity,
        met=np.zeros(n + 1, np.int32),
        queue=np.zeros(n + 1, np.uint32),
        waits=np.zeros(n, np.uint8),
        removed=np.zeros(n, np.float32),
    )


@kernel()
def _build_tables(
    magnitude: NDArray[np.float32],
    label: NDArray[np.int32],
    group_magnitude: NDArray[np.float32],
    anchor: NDArray[np.int32],
    column: NDArray[np.int64],
    sums: NDArray[np.float32],
    starts: NDArray[np.uint32],
    lines: NDArray[np.uint32],
) -> None:
    """Fill in `sums`, `starts` and `lines` of WindowIndex in one pass over the image.

    column: (w,) place in `lines` where each column starts, afterwards where it ends.
    """
    h, w = label.shape
    n = 0
    for y in range(h):
        in_row_groups, in_row_edges = np.float32(0), np.float32(0)
        for x in range(w):
            starts[y, x, 0], starts[y, x, 1] = n, column[x]
            g = label[y, x]
            if g >= 0:
                lines[0, n], lines[1, column[x]] = g, g
                n += 1
                column[x] += 1
                in_row_edges += magnitude[y, x]
                if anchor[g, 0] == x and anchor[g, 1] == y:
                    in_row_groups += group_magnitude[g]
            sums[y + 1, x + 1, 0] = sums[y, x + 1, 0] + in_row_groups
            sums[y + 1, x + 1, 1] = sums[y, x + 1, 1] + in_row_edges
        starts[y, w, 0] = n
