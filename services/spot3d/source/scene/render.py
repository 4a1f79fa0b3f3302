"""Ray caster of the built-in scene: depth, instances and shaded colour of a view."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import CORNERS, EDGES
from spot3d.camera import Intrinsics
from spot3d.kernel import kernel
from spot3d.source.scene.intersect import FAR, hit_box, hit_cone, hit_ellipsoid
from spot3d.source.scene.light import shadow_maps
from spot3d.source.scene.model import SceneModel
from spot3d.source.scene.shading import GAMMA, Image, Rays, shade
from spot3d.source.scene.shapes import BOX, CONE, ROOM
from spot3d.source.scene.texture import noise_table

NEAR = 0.02


@dataclass(frozen=True, slots=True)
class RenderedView:
    """Ground truth of one view, (h, w) each.

    depth: float32 metres along the optical axis. instance: int32, 0 = room and furniture. cosine: float32, of the angle
    between ray and surface normal. colour: (h, w, 3) uint8 RGB, without sensor noise.
    """

    depth: NDArray[np.float32]
    instance: NDArray[np.int32]
    cosine: NDArray[np.float32]
    colour: NDArray[np.uint8]


def empty_rendered_view(shape: tuple[int, int]) -> RenderedView:
    """A view of shape (h, w) to render into. Its arrays are uninitialised."""
    depth, cosine = np.empty((2, *shape), np.float32)
    return RenderedView(depth, np.empty(shape, np.int32), cosine, np.empty((*shape, 3), np.uint8))


class Renderer:
    """Renders views of one scene. Shadows and noise table, which all views share, are computed once."""

    def __init__(self, model: SceneModel, intrinsics: Intrinsics, seed: int) -> None:
        self.model = model
        self.intrinsics = intrinsics
        self._light = shadow_maps(model.solids, model.shaded)
        self._table = noise_table(seed)
        # Kept, as views are: fresh memory pages for each frame would take a tenth of its time.
        self._which = np.empty(intrinsics.shape, np.int32)
        self._sharp = np.empty((*intrinsics.shape, 3), np.uint8)

    def render(self, T_world_camera: NDArray[np.float64], view: RenderedView) -> None:
        """Fills `view` with what a camera at T_world_camera (4, 4) inside the room sees."""
        solids, intrinsics = self.model.solids, self.intrinsics
        shapes, which, colour = solids.shapes, self._which, self._sharp
        rotation, origin = T_world_camera[:3, :3], T_world_camera[:3, 3]
        # Rays in each primitive's frame: p + t * (a * x + b * y + c), where t is the depth.
        to_local = np.ascontiguousarray(np.einsum("nji,jk->nik", shapes.rotation, rotation))
        eye = np.einsum("nji,nj->ni", shapes.rotation, origin - shapes.centre)
        rectangles = self._rectangles(rotation, origin)
        pinhole = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
        view.depth[:] = FAR
        which[:] = 0
        rays = Rays(to_local, eye, rectangles, pinhole)
        _cast(shapes.kind, shapes.form, rays, view.depth, which)
        image = Image(view.depth, which, view.cosine, colour)
        shade(shapes, solids.surface, rays, self._light, self._table, GAMMA, image)
        # Imitates a small lens's sharpness, and softens the aliasing of one ray a pixel.
        cv2.GaussianBlur(colour, (3, 3), 0.7, dst=view.colour)
        np.take(solids.instance, which, out=view.instance, mode="clip")

    def _rectangles(self, rotation: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.int32]:
        """Pixel rectangles (n, 4) int32 [u from, u to, v from, v to) around each primitive's projected bounds."""
        solids, camera = self.model.solids, self.intrinsics
        corners = np.where(CORNERS < 0, solids.low[:, None], solids.high[:, None])
        world = np.einsum("nij,nkj->nki", solids.shapes.rotation, corners) + solids.shapes.centre[:, None]
        seen = (world - origin) @ rotation
        # Where an edge of the bounds reaches behind the camera, its intersection with the near plane replaces the
        # corner.
        a, b = seen[:, EDGES[:, 0]], seen[:, EDGES[:, 1]]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (NEAR - a[..., 2:]) / (b[..., 2:] - a[..., 2:])
            crossing = np.where((share > 0) & (share < 1), a + share * (b - a), np.nan)
        crossing[..., 2] = NEAR
        points = np.concatenate((np.where(seen[..., 2:] >= NEAR, seen, np.nan), crossing), axis=1)
        u = camera.fx * points[..., 0] / points[..., 2] + camera.cx
        v = camera.fy * points[..., 1] / points[..., 2] + camera.cy
        empty = ~np.isfinite(u).any(axis=1)
        u[empty] = v[empty] = -1.0
        bounds = np.nanmin(u, axis=1), np.nanmax(u, axis=1) + 2, np.nanmin(v, axis=1), np.nanmax(v, axis=1) + 2
        limits = (camera.width, camera.width, camera.height, camera.height)
        return np.asarray(np.clip(np.stack(bounds, axis=1), 0, limits).astype(np.int32))


@kernel()
def _cast(
    kind: NDArray[np.int32], form: NDArray[np.float64], rays: Rays, depth: NDArray[np.float32], which: NDArray[np.int32]
) -> None:
    """Writes the depth and the primitive of the nearest hit, one primitive after the other."""
    to_local, eye, rectangles, pinhole = rays
    fx, fy, cx, cy = pinhole
    for p in range(kind.shape[0]):
        m00, m10, m20 = to_local[p, 0, 0] / fx, to_local[p, 1, 0] / fx, to_local[p, 2, 0] / fx
        ox, oy, oz = eye[p, 0], eye[p, 1], eye[p, 2]
        half = (form[p, 0], form[p, 1], form[p, 2])
        here, inside, shape = kind[p], kind[p] == ROOM, form[p]
        for v in range(rectangles[p, 2], rectangles[p, 3]):
            y = (v - cy) / fy
            rx = to_local[p, 0, 1] * y + to_local[p, 0, 2] - m00 * cx
            ry = to_local[p, 1, 1] * y + to_local[p, 1, 2] - m10 * cx
            rz = to_local[p, 2, 1] * y + to_local[p, 2, 2] - m20 * cx
            first, last = rectangles[p, 0], rectangles[p, 1]
            if here in (BOX, ROOM):
                # No branches, so that the compiler vectorises this loop.
                for u in range(first, last):
                    dx, dy, dz = rx + m00 * u, ry + m10 * u, rz + m20 * u
                    t = hit_box(half, inside, (ox, oy, oz), dx, dy, dz)
                    nearer = t < depth[v, u]
                    depth[v, u] = t if nearer else depth[v, u]
                    which[v, u] = p if nearer else which[v, u]
                continue
            for u in range(first, last):
                dx, dy, dz = rx + m00 * u, ry + m10 * u, rz + m20 * u
                if here == CONE:
                    t = hit_cone(shape, ox, oy, oz, dx, dy, dz)
                else:
                    t = hit_ellipsoid(shape, ox, oy, oz, dx, dy, dz)
                if t < depth[v, u]:
                    depth[v, u] = t
                    which[v, u] = p
