"""Primitive solids of the built-in scene, their surfaces, and the arrays that the ray caster reads."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

BOX, CONE, ELLIPSOID, ROOM = 0, 1, 2, 3
PLAIN, STRIPES, CHECKS, SPECKLE, LABEL, WOOD, TILES, PICTURE, COVER = range(9)

Colour = tuple[float, float, float]
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Texture:
    """A primitive's pattern: two colours (0..1, linear RGB), and a period in metres."""

    pattern: int
    first: Colour
    second: Colour = (0.9, 0.9, 0.88)
    period: float = 0.05


@dataclass(frozen=True, slots=True)
class Primitive:
    """One solid in its own frame, with the origin at `centre` and the columns of `rotation` as axes.

    form, by kind:
    BOX, ROOM: half sizes (x, y, z); a room is seen from inside.
    CONE, truncated: half height, radius at the bottom, radius at the top, open (1: no top, hollow); axis z.
    ELLIPSOID: half axes (a, b, c), cut at z from and to, open (1: hollow, no lid at the upper cut).
    """

    kind: int
    form: tuple[float, ...]
    surface: Texture
    centre: Vector = (0.0, 0.0, 0.0)
    rotation: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def local_bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Exact least and greatest corner (3,) of the solid in its own frame."""
        if self.kind in (BOX, ROOM):
            half = np.array(self.form[:3])
            return -half, half
        if self.kind == CONE:
            radius = max(self.form[1], self.form[2])
            half = np.array([radius, radius, self.form[0]])
            return -half, half
        a, b, c, low, high = self.form[:5]
        widest = min(max(0.0, low), high)
        share = float(np.sqrt(max(0.0, 1 - (widest / c) ** 2)))
        return np.array([-a * share, -b * share, low]), np.array([a * share, b * share, high])

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest corner (3,) in the frame of `centre` and `rotation`."""
        low, high = self.local_bounds()
        rotation = np.array(self.rotation)
        centre = rotation @ ((low + high) / 2) + np.array(self.centre)
        half = np.abs(rotation) @ ((high - low) / 2)
        return centre - half, centre + half


class Shapes(NamedTuple):
    """Primitives that rays are cast at, one row each.

    kind: (n,) int32; form: (n, 6); rotation: (n, 3, 3) of T_world_primitive, centre: (n, 3); all float64, metres.
    """

    kind: NDArray[np.int32]
    form: NDArray[np.float64]
    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]


class SurfacePattern(NamedTuple):
    """Each primitive's pattern (n,) int32, first and second colour (n, 3), and patterns per metre (n,)."""

    pattern: NDArray[np.int32]
    first: NDArray[np.float64]
    second: NDArray[np.float64]
    frequency: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Solids:
    """All primitives of a scene as arrays for the compiled code, one row each.

    low, high: (n, 3) float64 bounds in the primitive's frame, metres; instance: (n,) int32, 0 = room and furniture.
    """

    shapes: Shapes
    surface: SurfacePattern
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    instance: NDArray[np.int32]


def pack(primitives: list[Primitive], instances: list[int]) -> Solids:
    """Arrays of primitives in the world, and of the instance that each belongs to."""
    form = np.zeros((len(primitives), 6))
    for row, primitive in zip(form, primitives, strict=True):
        row[: len(primitive.form)] = primitive.form
    kinds, surfaces = [p.kind for p in primitives], [p.surface for p in primitives]
    low, high = np.array([primitive.local_bounds() for primitive in primitives]).swapaxes(0, 1)
    return Solids(
        Shapes(
            np.array(kinds, np.int32),
            form,
            np.array([p.rotation for p in primitives], np.float64),
            np.array([p.centre for p in primitives], np.float64),
        ),
        SurfacePattern(
            np.array([s.pattern for s in surfaces], np.int32),
            np.array([s.first for s in surfaces], np.float64),
            np.array([s.second for s in surfaces], np.float64),
            1 / np.array([s.period for s in surfaces], np.float64),
        ),
        low,
        high,
        np.array(instances, np.int32),
    )


def placed(primitive: Primitive, yaw: float, base: Vector) -> Primitive:
    """A primitive of an object, turned by `yaw` about z and moved to `base`: from the object's frame to the world."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    x, y, z = (float(value) for value in turn @ np.array(primitive.centre) + np.array(base))
    first, second, third = ((float(r[0]), float(r[1]), float(r[2])) for r in turn @ primitive.rotation)
    return Primitive(primitive.kind, primitive.form, primitive.surface, (x, y, z), (first, second, third))
