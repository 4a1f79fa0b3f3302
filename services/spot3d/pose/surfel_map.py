"""The local map of planes: one surfel for each voxel and direction of its surface, in a hash table."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.pose.surface import Surface
from spot3d.voxel_hash import EMPTY, empty_table, find_slot, voxel_key

VOXEL = 0.05
"""Edge of a voxel of the map of planes, metres."""
# Columns of a surfel. Kept in snapshots: mean position (3), mean normal (3), weight, last frame that saw it, and mean
# position of the cameras that saw it (3). Beyond these: its motion along its normal if each of those cameras is turned
# about its own axes (3), metres a radian, and if points are sheared along their x and y with the distance (2), metres.
HELD, _COLUMNS = 11, 16
_POSE = 6
# Variance of weight one; it only keeps the weights near one.
_UNIT_VARIANCE = 1e-5
# Largest weight (about 300 views at 1 m), so that a surfel stays open to change.
_WEIGHT_MAX = 1000.0


class _Surfels(NamedTuple):
    """The map's arrays and parameters (see `SurfelMap`); voxel: metres."""

    keys: NDArray[np.int64]
    surfels: NDArray[np.float64]
    voxel: float
    beside: bool


class _Sums(NamedTuple):
    """Sums, and scratch rows (2, 6) of one point, by the map's normal and by its own.

    See `SurfelMap.normal_equations`; shared: (0, 6) where it is not asked for.
    """

    H: NDArray[np.float64]
    g: NDArray[np.float64]
    totals: NDArray[np.float64]
    shared: NDArray[np.float64]
    rows: NDArray[np.float64]


class SurfelMap:
    """Bounded map of planes in the world frame.

    keys: (slots,) int64, voxel coordinates and direction, -1 = free; surfels: (slots, 16) float64; forgotten: how many
    were dropped. beside: whether points up to half a voxel outside a plane's voxel match it, too, as given poses are
    off to either side. Odometry continues from its own pose, and a bend of depth then makes it slide: with `beside`
    KISS-ICP finds 0.82 of the objects of four near desks bent by 0.3 %, and not TUM's cabinet; without it 0.93, and
    the cabinet.
    """

    def __init__(self, voxel: float, limit: int, beside: bool = True) -> None:
        self.voxel = voxel
        self.limit = limit
        self.keys = empty_table(limit)
        self.surfels = np.zeros((len(self.keys), _COLUMNS))
        self._arrays = _Surfels(self.keys, self.surfels, voxel, beside)
        self.count = 0
        self.frames = 0
        self.forgotten = 0

    def insert(self, surface: Surface, T_world_camera: NDArray[np.float64]) -> None:
        """Average the surface points into their surfels, weighted by their noise."""
        self.frames += 1
        if self.count + len(surface.points) > self.limit:
            self._forget()
        pose = np.ascontiguousarray(T_world_camera, np.float64)
        room = self.limit - self.count
        self.count += _insert(self._arrays, surface, pose, self.frames, room)

    def held(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Keys (n,) and surfels (n, 11) of the map, copied."""
        used = np.flatnonzero(self.keys != EMPTY)
        return self.keys[used], self.surfels[used, :HELD]

    def restore(self, keys: NDArray[np.int64], surfels: NDArray[np.float64]) -> None:
        """Replace the map by what `held` returned of one with the same voxel size.

        Of more than `limit` surfels, those seen last are kept.
        """
        kept = np.sort(np.argsort(-surfels[:, 7], kind="stable")[: self.limit])
        keys, surfels = keys[kept], surfels[kept]
        self._hold(keys, surfels)
        self.frames = int(surfels[:, 7].max(initial=0))

    def normal_equations(
        self,
        surface: Surface,
        T_world_camera: NDArray[np.float64],
        distance: float,
        kernel: float,
        stride: int = 1,
        shared: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Point-to-plane normal equations of every `stride`-th point at a pose.

        Returns H (6, 6) and g (6,) of H x = g for the twist x (metres, radians; world axes, about the camera), and
        (points tried, points matched, sum of squared distances in m2). shared: (6, 6), to which the same is added as to
        H, but products of the map's row and the point's own, not squares of the map's: the noise of the two normals is
        independent and averages out in products; in squares it adds up.
        """
        asked = np.zeros((0, _POSE)) if shared is None else shared
        sums = _Sums(np.zeros((_POSE, _POSE)), np.zeros(_POSE), np.zeros(3), asked, np.empty((2, _POSE)))
        pose = np.ascontiguousarray(T_world_camera, np.float64)
        _normal_equations(self._arrays, surface, pose, distance, kernel, stride, sums)
        return sums.H, sums.g, sums.totals

    def rescale(self, factor: float) -> None:
        """Move every surfel to where it would be with depth `factor` times as large."""
        surfels = self.surfels[self.keys != EMPTY]
        surfels[:, :3] += (factor - 1) * (surfels[:, :3] - surfels[:, 8:11])
        self._hold_moved(surfels)

    def look_elsewhere(self, vector: NDArray[np.float64]) -> None:
        """Move every surfel to where it would be with each camera turned by a small rotation vector about its own axes,
        and its principal point offset: vector (5,)."""
        surfels = self.surfels[self.keys != EMPTY]
        normals = surfels[:, 3:6] / np.maximum(np.linalg.norm(surfels[:, 3:6], axis=1), 1e-9)[:, None]
        surfels[:, :3] += normals * (surfels[:, 11:] @ vector)[:, None]
        self._hold_moved(surfels)

    def _hold_moved(self, surfels: NDArray[np.float64]) -> None:
        """Replace the map by these surfels, each in the voxel where it now is."""
        keys = np.empty(len(surfels), np.int64)
        plane_keys(surfels, self.voxel, keys)
        # Of two that come to lie in one voxel, the one of larger weight stays.
        order = np.argsort(-surfels[:, 6], kind="stable")
        _, first = np.unique(keys[order], return_index=True)
        kept = np.sort(order[first])
        self._hold(keys[kept], surfels[kept])

    def _forget(self) -> None:
        """Drop the half of the surfels that was not seen for longest."""
        used = np.flatnonzero(self.keys != EMPTY)
        recent = used[np.argsort(-self.surfels[used, 7], kind="stable")[: self.limit // 2]]
        keys, surfels = self.keys[recent], self.surfels[recent]
        self.forgotten += self.count - len(keys)
        self._hold(keys, surfels)

    def _hold(self, keys: NDArray[np.int64], surfels: NDArray[np.float64]) -> None:
        self.keys.fill(EMPTY)
        self.surfels.fill(0)
        _restore(self._arrays, keys, surfels)
        self.count = len(keys)


@part()
def _side(nx: float, ny: float, nz: float) -> int:
    """The signed axis that a normal is nearest to, 0..5: +x, -x, +y, -y, +z, -z."""
    ax, ay, az = abs(nx), abs(ny), abs(nz)
    if ax >= ay and ax >= az:
        return 0 if nx > 0 else 1
    if ay >= az:
        return 2 if ny > 0 else 3
    return 4 if nz > 0 else 5


@part()
def _key(x: float, y: float, z: float, side: int, voxel: float) -> np.int64:
    """Key of a point's voxel and of its normal's side: the two sides of a board never mix."""
    i, j, k = np.floor(x / voxel), np.floor(y / voxel), np.floor(z / voxel)
    return voxel_key(np.int64(i), np.int64(j), np.int64(k), side)


@part()
def _beside(x: float, y: float, z: float, side: int, voxel: float) -> np.int64:
    """The key of the nearest neighbouring voxel of a point along the axis of its side."""
    along = (x if side < 2 else y if side < 4 else z) / voxel
    step = 0.5 * voxel if along - np.floor(along) >= 0.5 else -0.5 * voxel
    if side < 2:
        x += step
    elif side < 4:
        y += step
    else:
        z += step
    return _key(x, y, z, side, voxel)


@kernel("void(f8[:,::1], f8, i8[::1])")
def plane_keys(surfels: NDArray[np.float64], voxel: float, keys: NDArray[np.int64]) -> None:
    """The keys (n,) of positions with normals, (n, 6 or more), by voxel and side."""
    for i in range(surfels.shape[0]):
        s = surfels[i]
        keys[i] = _key(s[0], s[1], s[2], _side(s[3], s[4], s[5]), voxel)


@kernel()
def _restore(known: _Surfels, kept_keys: NDArray[np.int64], kept: NDArray[np.float64]) -> None:
    """Put kept surfels back into the empty table."""
    for i in range(kept_keys.shape[0]):
        h = find_slot(known.keys, kept_keys[i])
        known.keys[h] = kept_keys[i]
        known.surfels[h, : kept.shape[1]] = kept[i]


@kernel()
def _insert(known: _Surfels, surface: Surface, T: NDArray[np.float64], frame: int, room: int) -> int:
    """Running means of position and normal; returns the number of new surfels, at most `room`. T: the pose (4, 4)."""
    keys, surfels, voxel, _ = known
    points, normals, sigma = surface
    new = 0
    for i in range(points.shape[0]):
        p, n = points[i], normals[i]
        x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
        y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
        z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
        nx = T[0, 0] * n[0] + T[0, 1] * n[1] + T[0, 2] * n[2]
        ny = T[1, 0] * n[0] + T[1, 1] * n[1] + T[1, 2] * n[2]
        nz = T[2, 0] * n[0] + T[2, 1] * n[1] + T[2, 2] * n[2]
        key = _key(x, y, z, _side(nx, ny, nz), voxel)
        h = find_slot(keys, key)
        if keys[h] == -1:
            if new >= room:
                continue
            keys[h] = key
            new += 1
        s = surfels[h]
        weight = _UNIT_VARIANCE / (sigma[i] * sigma[i])
        share = weight / (s[6] + weight)
        s[0] += share * (x - s[0])
        s[1] += share * (y - s[1])
        s[2] += share * (z - s[2])
        s[3] += share * (nx - s[3])
        s[4] += share * (ny - s[4])
        s[5] += share * (nz - s[5])
        s[6] = min(s[6] + weight, _WEIGHT_MAX)
        s[7] = frame
        s[8] += share * (T[0, 3] - s[8])
        s[9] += share * (T[1, 3] - s[9])
        s[10] += share * (T[2, 3] - s[10])
        s[11] += share * (p[1] * n[2] - p[2] * n[1] - s[11])
        s[12] += share * (p[2] * n[0] - p[0] * n[2] - s[12])
        s[13] += share * (p[0] * n[1] - p[1] * n[0] - s[13])
        s[14] += share * (p[2] * n[0] - s[14])
        s[15] += share * (p[2] * n[1] - s[15])
    return new


@kernel()
def _normal_equations(
    known: _Surfels, surface: Surface, T: NDArray[np.float64], distance: float, kernel: float, stride: int, sums: _Sums
) -> None:
    """Sum H, g and the totals over every stride-th point; Geman-McClure weights, inverse noise variance."""
    keys, surfels, voxel, beside = known
    points, normals, sigma = surface
    H, g, totals, shared, rows = sums
    J, own = rows[0], rows[1]
    for i in range(0, points.shape[0], stride):
        totals[0] += 1
        p, n = points[i], normals[i]
        # The lever arm from the camera keeps H well conditioned wherever the world's origin lies.
        lx = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2]
        ly = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2]
        lz = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2]
        x, y, z = lx + T[0, 3], ly + T[1, 3], lz + T[2, 3]
        nx = T[0, 0] * n[0] + T[0, 1] * n[1] + T[0, 2] * n[2]
        ny = T[1, 0] * n[0] + T[1, 1] * n[1] + T[1, 2] * n[2]
        nz = T[2, 0] * n[0] + T[2, 1] * n[1] + T[2, 2] * n[2]
        side, near = _side(nx, ny, nz), distance
        h = find_slot(keys, _key(x, y, z, side, voxel))
        if keys[h] == -1 and beside:
            # A pose that is a little off puts a plane near the border between two voxels into the other one.
            h, near = find_slot(keys, _beside(x, y, z, side, voxel)), min(distance, 0.5 * voxel)
        if keys[h] == -1:
            continue
        s = surfels[h]
        length = np.sqrt(s[3] * s[3] + s[4] * s[4] + s[5] * s[5])
        # A short mean normal means a crease: there is no one plane to measure against.
        if length < 0.9:
            continue
        mx, my, mz = s[3] / length, s[4] / length, s[5] / length
        if mx * nx + my * ny + mz * nz < 0.7:
            continue
        r = mx * (x - s[0]) + my * (y - s[1]) + mz * (z - s[2])
        if abs(r) > near:
            continue
        scaled = r / (kernel * sigma[i])
        robust = 1.0 / (1.0 + scaled * scaled)
        weight = robust * robust / (sigma[i] * sigma[i])
        J[0], J[1], J[2] = mx, my, mz
        J[3], J[4], J[5] = ly * mz - lz * my, lz * mx - lx * mz, lx * my - ly * mx
        for a in range(_POSE):
            wj = weight * J[a]
            g[a] -= wj * r
            for b in range(a, _POSE):
                H[a, b] += wj * J[b]
        if len(shared):
            own[0], own[1], own[2] = nx, ny, nz
            own[3], own[4], own[5] = ly * nz - lz * ny, lz * nx - lx * nz, lx * ny - ly * nx
            for a in range(_POSE):
                wj = weight * J[a]
                for b in range(_POSE):
                    shared[a, b] += wj * own[b]
        totals[1] += 1
        totals[2] += r * r
    for a in range(_POSE):
        for b in range(a):
            H[a, b] = H[b, a]
