"""Compiled ray intersections with primitive solids."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.source.scene.shapes import BOX, CONE, ROOM

FAR = 1e9
# Thickness of the floor of hollow things, metres; it keeps the floor from coinciding with their support.
FLOOR = 0.004


@part()
def hit_box(
    half: tuple[float, float, float], inside: bool, eye: tuple[float, float, float], dx: float, dy: float, dz: float
) -> float:
    """Ray parameter where a ray enters a box of these half sizes, or leaves it if `inside`. FAR if it misses."""
    (hx, hy, hz), (ox, oy, oz) = half, eye
    # A ray parallel to a side gets a huge but finite inverse, so that zeros need no branch.
    ix = 1.0 / (dx if abs(dx) > 1e-12 else 1e-12)
    iy = 1.0 / (dy if abs(dy) > 1e-12 else 1e-12)
    iz = 1.0 / (dz if abs(dz) > 1e-12 else 1e-12)
    mx, my, mz = -ox * ix, -oy * iy, -oz * iz
    rx, ry, rz = abs(hx * ix), abs(hy * iy), abs(hz * iz)
    near, far = mx - rx, mx + rx
    near = my - ry if my - ry > near else near
    near = mz - rz if mz - rz > near else near
    far = my + ry if my + ry < far else far
    far = mz + rz if mz + rz < far else far
    t = far if inside else near
    return t if near <= far and t > 0 else FAR


@kernel()
def hit_cone(form: NDArray[np.float64], ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Least positive ray parameter on a truncated cone (half height, bottom and top radius, open). FAR if it misses."""
    half, bottom, top = form[0], form[1], form[2]
    slope = (top - bottom) / (2 * half)
    radius = (bottom + top) / 2 + slope * oz
    widen = slope * dz
    a = dx * dx + dy * dy - widen * widen
    b = ox * dx + oy * dy - radius * widen
    c = ox * ox + oy * oy - radius * radius
    best = FAR
    root = b * b - a * c
    if root >= 0 and abs(a) > 1e-15:
        root = np.sqrt(root)
        for sign in (-1.0, 1.0):
            t = (-b + sign * root) / a
            if 0 < t < best and abs(oz + t * dz) <= half:
                best = t
    if abs(dz) > 1e-12:
        for side in (-1.0, 1.0):
            if side > 0 and form[3] > 0:
                continue
            level = side * half + (FLOOR if form[3] > 0 else 0.0)
            t = (level - oz) / dz
            x, y = ox + t * dx, oy + t * dy
            limit = (bottom + top) / 2 + slope * level
            if 0 < t < best and x * x + y * y <= limit * limit:
                best = t
    return best


@kernel()
def hit_ellipsoid(form: NDArray[np.float64], ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Least positive ray parameter on a cut ellipsoid (a, b, c, z from, z to, open). FAR if it misses."""
    sx, sy, sz = 1.0 / form[0], 1.0 / form[1], 1.0 / form[2]
    ex, ey, ez = dx * sx, dy * sy, dz * sz
    px, py, pz = ox * sx, oy * sy, oz * sz
    a = ex * ex + ey * ey + ez * ez
    b = px * ex + py * ey + pz * ez
    c = px * px + py * py + pz * pz - 1
    root = b * b - a * c
    if root < 0:
        return FAR
    root = np.sqrt(root)
    best = FAR
    for sign in (-1.0, 1.0):
        t = (-b + sign * root) / a
        if 0 < t < best and form[3] <= oz + t * dz <= form[4]:
            best = t
    if abs(dz) > 1e-12:
        for cut in (3, 4):
            if cut == 4 and form[5] > 0:
                continue
            level = form[cut] + (FLOOR if form[5] > 0 else 0.0)
            t = (level - oz) / dz
            x, y, z = px + t * ex, py + t * ey, level * sz
            if 0 < t < best and x * x + y * y + z * z <= 1:
                best = t
    return best


@part()
def hit(
    kind: int, form: NDArray[np.float64], ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> float:
    """Least positive ray parameter on a primitive. The ray is given in its frame. FAR if it misses."""
    if kind in (BOX, ROOM):
        return hit_box((form[0], form[1], form[2]), kind == ROOM, (ox, oy, oz), dx, dy, dz)
    if kind == CONE:
        return hit_cone(form, ox, oy, oz, dx, dy, dz)
    return hit_ellipsoid(form, ox, oy, oz, dx, dy, dz)


@part()
def outward_normal(
    kind: int, form: NDArray[np.float64], p: int, x: float, y: float, z: float
) -> tuple[float, float, float, int]:
    """Unit normal and face at a surface point of primitive `p`, in its frame.

    form: (n, 6), of all primitives. Face: 0, 1, 2 flat across x, y, z; 3 curved. The normal points outwards on a room
    and on the inside of a hollow thing, too: turn it towards the viewer.
    """
    if kind in (BOX, ROOM):
        ax, ay, az = abs(x) - form[p, 0], abs(y) - form[p, 1], abs(z) - form[p, 2]
        if ax >= ay and ax >= az:
            return (1.0 if x > 0 else -1.0), 0.0, 0.0, 0
        if ay >= az:
            return 0.0, (1.0 if y > 0 else -1.0), 0.0, 1
        return 0.0, 0.0, (1.0 if z > 0 else -1.0), 2
    # Depth is float32, accurate to 1e-7 of its value.
    close = 2e-6
    if kind == CONE:
        slope = (form[p, 2] - form[p, 1]) / (2 * form[p, 0])
        distance = np.sqrt(x * x + y * y)
        level = -form[p, 0] + (FLOOR if form[p, 3] > 0 else 0.0)
        within = distance < (form[p, 1] + form[p, 2]) / 2 + slope * z - close
        if within and (abs(z - level) < close or form[p, 0] - z < close):
            return 0.0, 0.0, (-1.0 if z < 0 else 1.0), 2
        nx, ny, nz = x, y, -slope * distance
    else:
        a, b, c = form[p, 0], form[p, 1], form[p, 2]
        level = form[p, 3] + (FLOOR if form[p, 5] > 0 else 0.0)
        within = (x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 < 1 - 1e-4
        if within and (abs(z - level) < close or abs(z - form[p, 4]) < close):
            return 0.0, 0.0, (-1.0 if z < 0 else 1.0), 2
        nx, ny, nz = x / (a * a), y / (b * b), z / (c * c)
    scale = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz + 1e-30)
    return nx * scale, ny * scale, nz * scale, 3
