"""Normal equations of frames that see the same planes, with the planes' own parameters eliminated."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d_schemas.limits import BEND_SHAPE

POSE = 6
"""Unknowns of each frame: shift, and rotation about its camera, world axes."""
BEND_NODES = BEND_SHAPE[::-1]
"""Columns and rows of the lattice of depth's bend; with 12 and 8 redkitchen tells the same scale within 0.2 %."""
OPTICS = 4 + BEND_NODES[0] * BEND_NODES[1]
"""Unknowns shared by all frames: logarithm of depth's scale, the principal point's offset along x and y (see
`Calibration`), logarithm of how much wider the camera sees than its intrinsics say, and logarithm of the relative scale
of depth at each node of the lattice, row by row, bilinear between them.
"""
# Unknowns of a point: those of its frame, four shared ones, and the nodes around it. Of a plane: distance and slants.
_LENS, _AROUND, _PLANE = 4, 4, 3
_ROW = POSE + _LENS + _AROUND
# Standard deviation of a plane's slants against the mean normal: surfaces bent more within a voxel are no plane.
_SLANT = 0.1
# Keeps the equations of a plane that is seen in one spot finite.
_RIDGE = 1e-6


class SeenPoints(NamedTuple):
    """Points of all frames, sorted by their plane, and by their frame within each.

    places, arms, normals: (n, 3), world; arms are from the frame's camera; sigma: (n,) metres; frame: (n,) index;
    cells, shares: (n, 4) the lattice nodes around each point, and their weights; first: (m + 1,) row at which each
    plane's points begin; axes: (frames, 3, 3) the cameras' rotations.
    """

    places: NDArray[np.float64]
    arms: NDArray[np.float64]
    normals: NDArray[np.float64]
    sigma: NDArray[np.float64]
    frame: NDArray[np.int64]
    cells: NDArray[np.int64]
    shares: NDArray[np.float64]
    first: NDArray[np.int64]
    axes: NDArray[np.float64]


class _Fitted(NamedTuple):
    """points: (n, 4) distance to the plane, coordinates in it (2), metres, and weight, 0 = of no plane; normals: (m, 3)
    of the planes."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]


class _Room(NamedTuple):
    """Sums H (upper triangle) and g, and scratch arrays of one plane.

    across: (3, k) the plane's unknowns by the shared ones and then by those of the frames that see it; explained: (3,
    k) the plane's inverse times that; frames: which see it; row: (14,) one point's; own: (3, 7) the plane's equations,
    their inverse and right side.
    """

    H: NDArray[np.float64]
    g: NDArray[np.float64]
    across: NDArray[np.float64]
    explained: NDArray[np.float64]
    frames: NDArray[np.int64]
    row: NDArray[np.float64]
    own: NDArray[np.float64]


def plane_equations(
    seen: SeenPoints, distance: float, scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """H (k, k) and g (k,) of H x = g, by all planes that two or more frames see; and variance of unit weight.

    k: the unknowns of each frame, then the shared ones. Points within `distance` metres of their plane count by their
    inverse variance, with Geman-McClure weights of scale `scale`, in standard deviations.
    """
    frames, planes = len(seen.axes), len(seen.first) - 1
    size = POSE * frames + OPTICS
    fitted = _Fitted(np.zeros((len(seen.places), 4)), np.zeros((planes, 3)))
    own = np.zeros((_PLANE, 7))
    _fit(seen, distance, scale, fitted, own)
    across, explained = np.zeros((2, _PLANE, size))
    room = _Room(
        np.zeros((size, size)), np.zeros(size), across, explained, np.zeros(frames, np.int64), np.zeros(_ROW), own
    )
    _sum_up(seen, fitted, room)
    H = np.triu(room.H)
    off, sure = fitted.points[:, 0], fitted.points[:, 3] * seen.sigma**2
    expected = float(sure @ seen.sigma**2)
    return H + np.triu(H, 1).T, room.g, float(sure @ off**2) / expected if expected else 1.0


@part()
def _add(M: NDArray[np.float64], v: NDArray[np.float64], weight: float, away: float, u: float, w: float) -> None:
    """Add a point `away` from its plane to the plane's equations M (3, 3), upper triangle, and v (3,)."""
    M[0, 0] += weight
    M[0, 1] += weight * u
    M[0, 2] += weight * w
    M[1, 1] += weight * u * u
    M[1, 2] += weight * u * w
    M[2, 2] += weight * w * w
    v[0] += weight * away
    v[1] += weight * away * u
    v[2] += weight * away * w


@part()
def _solved(M: NDArray[np.float64], inverse: NDArray[np.float64]) -> None:
    """Inverse of a symmetric (3, 3)."""
    a, b, c, d, e, f = M[0, 0], M[0, 1], M[0, 2], M[1, 1], M[1, 2], M[2, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * A + b * B + c * C
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = A / det, B / det, C / det
    inverse[1, 0], inverse[1, 1], inverse[1, 2] = B / det, (a * f - c * c) / det, (b * c - a * e) / det
    inverse[2, 0], inverse[2, 1], inverse[2, 2] = C / det, (b * c - a * e) / det, (a * d - b * b) / det


@kernel()
def _fit(seen: SeenPoints, distance: float, scale: float, fitted: _Fitted, own: NDArray[np.float64]) -> None:
    """Fit a plane, near the mean normal, to the points of each voxel that two or more frames see."""
    places, _, normals, sigma, frame, _, _, first, _ = seen
    points, planes = fitted
    M, inverse, v = own[:, :3], own[:, 3:6], own[:, 6]
    for plane in range(first.shape[0] - 1):
        begin, end = first[plane], first[plane + 1]
        if frame[begin] == frame[end - 1]:
            continue
        x = y = z = mx = my = mz = total = 0.0
        for i in range(begin, end):
            weight = 1 / (sigma[i] * sigma[i])
            p, n = places[i], normals[i]
            total += weight
            x += weight * p[0]
            y += weight * p[1]
            z += weight * p[2]
            mx += weight * n[0]
            my += weight * n[1]
            mz += weight * n[2]
        length = np.sqrt(mx * mx + my * my + mz * mz)
        # A short mean normal means a crease: there is no one plane.
        if length < 0.9 * total:
            continue
        x, y, z, mx, my, mz = x / total, y / total, z / total, mx / length, my / length, mz / length
        # Two directions in the plane.
        if abs(mx) < 0.8:
            ax, ay, az = 1 - mx * mx, -mx * my, -mx * mz
        else:
            ax, ay, az = -my * mx, 1 - my * my, -my * mz
        length = np.sqrt(ax * ax + ay * ay + az * az)
        ax, ay, az = ax / length, ay / length, az / length
        bx, by, bz = my * az - mz * ay, mz * ax - mx * az, mx * ay - my * ax
        M[:] = 0
        v[:] = 0
        M[1, 1] = M[2, 2] = 1 / _SLANT**2
        for i in range(begin, end):
            dx, dy, dz = places[i, 0] - x, places[i, 1] - y, places[i, 2] - z
            away, u, w = mx * dx + my * dy + mz * dz, ax * dx + ay * dy + az * dz, bx * dx + by * dy + bz * dz
            points[i, 0], points[i, 1], points[i, 2] = away, u, w
            weight = 1 / (sigma[i] * sigma[i])
            _add(M, v, weight, away, u, w)
        _solved(M, inverse)
        f0 = inverse[0, 0] * v[0] + inverse[0, 1] * v[1] + inverse[0, 2] * v[2]
        f1 = inverse[1, 0] * v[0] + inverse[1, 1] * v[1] + inverse[1, 2] * v[2]
        f2 = inverse[2, 0] * v[0] + inverse[2, 1] * v[1] + inverse[2, 2] * v[2]
        planes[plane, 0], planes[plane, 1], planes[plane, 2] = mx, my, mz
        for i in range(begin, end):
            off = points[i, 0] - f0 - f1 * points[i, 1] - f2 * points[i, 2]
            points[i, 0] = off
            if abs(off) <= distance:
                scaled = off / (scale * sigma[i])
                points[i, 3] = 1 / ((1 + scaled * scaled) * sigma[i]) ** 2


@kernel()
def _sum_up(seen: SeenPoints, fitted: _Fitted, room: _Room) -> None:
    """Sum H and g over all points, with the planes' unknowns eliminated (Schur complement)."""
    _, arms, _, _, frame, cells, shares, first, axes = seen
    points, planes = fitted
    H, g, across, explained, frames, J, own = room
    M, inverse, v = own[:, :3], own[:, 3:6], own[:, 6]
    shared = H.shape[0] - OPTICS
    for plane in range(planes.shape[0]):
        mx, my, mz = planes[plane]
        if mx == 0 and my == 0 and mz == 0:
            continue
        M[:] = 0
        v[:] = 0
        M[0, 0] = _RIDGE
        M[1, 1] = M[2, 2] = 1 / _SLANT**2
        across[:, :OPTICS] = 0
        count = 0
        for i in range(first[plane], first[plane + 1]):
            off, u, w, weight = points[i]
            if weight == 0:
                continue
            k = frame[i]
            if count == 0 or frames[count - 1] != k:
                frames[count] = k
                count += 1
                across[:, OPTICS + POSE * (count - 1) : OPTICS + POSE * count] = 0
            # The lever arm of the plane, not of the point, whose noise is in its distance as well.
            x, y, z = arms[i, 0] - off * mx, arms[i, 1] - off * my, arms[i, 2] - off * mz
            R = axes[k]
            cx, cy = R[0, 0] * mx + R[1, 0] * my + R[2, 0] * mz, R[0, 1] * mx + R[1, 1] * my + R[2, 1] * mz
            px, py = R[0, 0] * x + R[1, 0] * y + R[2, 0] * z, R[0, 1] * x + R[1, 1] * y + R[2, 1] * z
            pz = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
            J[0], J[1], J[2] = mx, my, mz
            J[3], J[4], J[5] = y * mz - z * my, z * mx - x * mz, x * my - y * mx
            J[6] = mx * x + my * y + mz * z
            J[7], J[8], J[9] = pz * cx, pz * cy, px * cx + py * cy
            for a in range(_ROW):
                near = a - POSE - _LENS
                if near >= 0:
                    J[a] = J[6] * shares[i, near]
                if a < POSE:
                    row, mine = POSE * k + a, OPTICS + POSE * (count - 1) + a
                else:
                    mine = a - POSE if near < 0 else _LENS + cells[i, near]
                    row = shared + mine
                by = weight * J[a]
                g[row] -= by * off
                across[0, mine] += by
                across[1, mine] += by * u
                across[2, mine] += by * w
                for b in range(a, POSE):
                    H[row, POSE * k + b] += by * J[b]
                for b in range(max(a, POSE), POSE + _LENS):
                    H[row, shared + b - POSE] += by * J[b]
                for b in range(max(near, 0), _AROUND):
                    H[row, shared + _LENS + cells[i, b]] += by * J[6] * shares[i, b]
            _add(M, v, weight, off, u, w)
        _solved(M, inverse)
        width = OPTICS + POSE * count
        for a in range(width):
            for c in range(_PLANE):
                explained[c, a] = 0
                for d in range(_PLANE):
                    explained[c, a] += inverse[c, d] * across[d, a]
        for a in range(width):
            s0, s1, s2 = explained[0, a], explained[1, a], explained[2, a]
            row = shared + a if a < OPTICS else POSE * frames[(a - OPTICS) // POSE] + (a - OPTICS) % POSE
            g[row] += s0 * v[0] + s1 * v[1] + s2 * v[2]
            # Shared unknowns come last, and frames in ascending order: only the upper triangle is written.
            for b in range(OPTICS):
                H[row, shared + b] -= s0 * across[0, b] + s1 * across[1, b] + s2 * across[2, b]
            if a < OPTICS:
                continue
            for n in range((a - OPTICS) // POSE, count):
                begin, column = OPTICS + POSE * n, POSE * frames[n]
                for b in range(POSE):
                    H[row, column + b] -= (
                        s0 * across[0, begin + b] + s1 * across[1, begin + b] + s2 * across[2, begin + b]
                    )
