"""Surface points of a depth image: local plane fits, which average noise and give normals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.kernel import kernel
from spot3d.pose.settings import PoseSettings
from spot3d.sensor import axial_noise_kernel

# Sums over a cell's valid pixels, u and v counted from its centre, q = 1/z: n u v uu uv vv q uq vq qq.
_SUMS = 10
_SHARE = 8
# Share of valid pixels that a plane fit needs.
_FILL_MIN = 0.8
# Largest residual of a plane fit, in standard deviations of the depth noise.
_FLATNESS = 2.0
GRAZING_COS = 0.26
"""Smallest cosine between the viewing ray and the normal of a surface point."""
POINTS_MIN = 300
"""Fewest surface points from which the pose of a frame is estimated."""


class Surface(NamedTuple):
    """Points on smooth surfaces in the camera frame.

    points: (n, 3) float32 metres; normals: (n, 3) float32, unit, towards the camera;
    sigma: (n,) float32, standard deviation of one pixel's depth there, metres.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    sigma: NDArray[np.float32]


def sample_surface(depth_m: NDArray[np.float32], camera: Intrinsics, settings: PoseSettings) -> Surface:
    """Surface points on a lattice of at most `lattice_width` columns.

    depth_m: (h, w) float32 metres, 0 = invalid. Each point is a plane fit over 3 x 3 lattice cells: a plane's
    inverse depth is affine in the pixel, and a structured-light sensor's noise is even in inverse depth.
    Cells across depth jumps, with holes, at grazing angles or beyond `range_max` give no point.
    """
    if depth_m.shape != camera.shape:
        raise ValueError(f"depth is {depth_m.shape}, but the intrinsics are for {camera.shape}")
    cell = -(-camera.width // settings.lattice_width)
    rows, columns = camera.height // cell, camera.width // cell
    sums = np.empty((rows, columns, _SUMS), np.float32)
    _sum_cells(np.ascontiguousarray(depth_m, np.float32), cell, np.float32(settings.range_max), sums)
    points = np.empty((rows * columns, 3), np.float32)
    normals = np.empty_like(points)
    sigma = np.empty(rows * columns, np.float32)
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    count = _fit_planes(sums, cell, lens, camera.noise.coefficients(), points, normals, sigma)
    return Surface(points[:count], normals[:count], sigma[:count])


def why_few(depth_m: NDArray[np.float32], found: int, settings: PoseSettings) -> str:
    """Why a depth image, (h, w) float32 metres, has so few surface points: no depth, none in range, or no surface.

    A wrong unit, millimetres for metres, puts all depth out of range.
    """
    valid = depth_m[depth_m > 0]
    if not valid.size:
        return "the depth image is empty"
    middle = float(np.median(valid))
    if middle >= settings.range_max:
        return (
            f"the median depth is {middle:.3g} m, and only depth below {settings.range_max:g} m is used; check its "
            "unit (depth_scale), which --depth-unit sets for a folder"
        )
    return f"only {found} points on smooth surfaces, but {POINTS_MIN} are needed"


def information(surface: Surface) -> NDArray[np.float64]:
    """Information (6, 6) on the pose from a point-to-plane registration of these points, 1/m2 and 1/rad2.

    For a shift and a turn about the camera in its own axes, if the points had independent noise `sigma`. Computed from
    every eighth point, for speed.
    """
    points, normals = surface.points[::_SHARE].astype(np.float64), surface.normals[::_SHARE].astype(np.float64)
    J = np.hstack((normals, np.cross(points, normals))) / surface.sigma[::_SHARE, None]
    return np.asarray(_SHARE * (J.T @ J))


@kernel()
def _sum_cells(depth: NDArray[np.float32], cell: int, range_max: np.float32, sums: NDArray[np.float32]) -> None:
    """Sums of each cell x cell block of the (h, w) depth into (rows, columns, 10)."""
    rows, columns, _ = sums.shape
    centre = np.float32(0.5 * (cell - 1))
    one, zero = np.float32(1), np.float32(0)
    # Allocated here, so that it cannot overlap with the depth: otherwise the loop is not vectorised.
    down = np.empty((6, columns * cell), np.float32)
    n0, n1, n2, q0, q1, q2 = down
    for row in range(rows):
        down[:] = 0
        for j in range(cell):
            v = np.float32(j) - centre
            line = depth[row * cell + j]
            for i in range(columns * cell):  # free of branches, so that it is vectorised
                valid = (line[i] > zero) & (line[i] < range_max)
                n = one if valid else zero
                q = one / line[i] if valid else zero
                n0[i] += n
                n1[i] += v * n
                n2[i] += v * v * n
                q0[i] += q
                q1[i] += v * q
                q2[i] += q * q
        for column in range(columns):
            n = su = sv = suu = suv = svv = sq = suq = svq = sqq = zero
            for k in range(cell):
                u, i = np.float32(k) - centre, column * cell + k
                n += n0[i]
                su += u * n0[i]
                sv += n1[i]
                suu += u * u * n0[i]
                suv += u * n1[i]
                svv += n2[i]
                sq += q0[i]
                suq += u * q0[i]
                svq += q1[i]
                sqq += q2[i]
            s = sums[row, column]
            s[0], s[1], s[2], s[3], s[4] = n, su, sv, suu, suv
            s[5], s[6], s[7], s[8], s[9] = svv, sq, suq, svq, sqq


@kernel()
def _fit_planes(
    sums: NDArray[np.float32],
    cell: int,
    lens: NDArray[np.float64],
    noise_model: tuple[np.float32, np.float32, np.float32],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    sigma: NDArray[np.float32],
) -> int:
    """Least-squares q = a u + b v + c over 3 x 3 cells; writes the points, returns their count."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    rows, columns, _ = sums.shape
    least = _FILL_MIN * 9 * cell * cell
    count = 0
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            n = su = sv = suu = suv = svv = sq = suq = svq = sqq = 0.0
            for j in range(-1, 2):
                dv = float(j * cell)
                for i in range(-1, 2):
                    du = float(i * cell)
                    s = sums[row + j, column + i]
                    m = float(s[0])
                    n += m
                    su += s[1] + du * m
                    sv += s[2] + dv * m
                    suu += s[3] + 2 * du * s[1] + du * du * m
                    suv += s[4] + du * s[2] + dv * s[1] + du * dv * m
                    svv += s[5] + 2 * dv * s[2] + dv * dv * m
                    sq += s[6]
                    suq += s[7] + du * s[6]
                    svq += s[8] + dv * s[6]
                    sqq += s[9]
            if n < least or n < 6:
                continue
            mu, mv, mq = su / n, sv / n, sq / n
            cuu, cuv, cvv = suu / n - mu * mu, suv / n - mu * mv, svv / n - mv * mv
            cuq, cvq, cqq = suq / n - mu * mq, svq / n - mv * mq, sqq / n - mq * mq
            det = cuu * cvv - cuv * cuv
            if det <= 1e-9:
                continue
            a = (cuq * cvv - cvq * cuv) / det
            b = (cvq * cuu - cuq * cuv) / det
            z = 1.0 / mq
            noise = axial_noise_kernel(np.float32(z), noise_model)
            # dz = z^2 dq turns the residual of the fit into metres.
            if not np.sqrt(max(cqq - a * cuq - b * cvq, 0.0)) * z * z <= _FLATNESS * noise:
                continue  # also where sums overflowed and it is no number
            u = column * cell + 0.5 * (cell - 1) + mu - cx
            v = row * cell + 0.5 * (cell - 1) + mv - cy
            # 1/z = a u + b v + c is the plane (a fx) x + (b fy) y + (mq - a u - b v) z = 1.
            nx, ny, nz = a * fx, b * fy, mq - a * u - b * v
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            x, y = u / fx * z, v / fy * z
            if GRAZING_COS * length * np.sqrt(x * x + y * y + z * z) > 1.0:
                continue
            points[count, 0], points[count, 1], points[count, 2] = x, y, z
            normals[count, 0], normals[count, 1], normals[count, 2] = -nx / length, -ny / length, -nz / length
            sigma[count] = noise
            count += 1
    return count
