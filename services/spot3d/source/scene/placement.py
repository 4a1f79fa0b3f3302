"""Places things on supports by seed, without interpenetration; some touching, hidden or stacked on purpose."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.source.scene.objects import CRATE_WALL, Thing, make

Region = tuple[float, float, float, float]
"""A rectangle on a support's upper side in the world, metres: x from, x to, y from, y to."""
TABLE_HEIGHT = 0.75
TOUCHING_GAP = 0.001
ANY_YAW = (-np.pi, np.pi)
# Circumradius of the 16-gon around a circle of radius 1, the footprint of round things.
CORNERS = 1 / np.cos(np.pi / 16)


@dataclass(frozen=True, slots=True)
class Placed:
    """A thing standing at (x, y) with its base at height z, turned by yaw (radians)."""

    thing: Thing
    x: float
    y: float
    z: float
    yaw: float


class NoRoomError(Exception):
    """A thing found no free place. The arrangement is drawn anew."""


def arrange(stream: tuple[int, ...], gap: float, region: Region, fill: Callable[["Arrangement"], None]) -> list[Placed]:
    """The things that `fill` places, by the random `stream` alone. Drawn anew until all find a place."""
    for attempt in range(1000):
        arrangement = Arrangement(np.random.default_rng((*stream, attempt)), gap, region)
        try:
            fill(arrangement)
        except NoRoomError:
            continue
        return arrangement.done
    raise RuntimeError(f"scene {stream}: no arrangement of its objects found in 1000 attempts; choose another seed")


class Arrangement:
    """Things placed on a support within `region`, at least `gap` metres apart unless they touch on purpose."""

    def __init__(self, rng: np.random.Generator, gap: float, region: Region) -> None:
        self.rng = rng
        self.gap = gap
        self.region = region
        self.done: list[Placed] = []

    def stand(
        self, name: str, region: Region | None = None, height: float = TABLE_HEIGHT, yaw: tuple[float, float] = ANY_YAW
    ) -> Placed:
        """Places a thing at random in a region (default: the arrangement's), with a yaw from a range (radians)."""
        return self.put(make(name, self.rng), region, height, yaw)

    def put(
        self,
        thing: Thing,
        region: Region | None = None,
        height: float = TABLE_HEIGHT,
        yaw: tuple[float, float] = ANY_YAW,
    ) -> Placed:
        """Like `stand`, for a thing that is already made."""
        region = region or self.region
        for _ in range(150):
            x, y = self.rng.uniform(region[0], region[1]), self.rng.uniform(region[2], region[3])
            candidate = Placed(thing, float(x), float(y), height, float(self.rng.uniform(*yaw)))
            if self.free(candidate, region):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(thing.name)

    def stack(self, name: str, base: Placed) -> Placed:
        """Places a thing on another, with its whole base on the other's top."""
        thing = make(name, self.rng)
        for turn in (float(self.rng.uniform(-0.6, 0.6)), 0.0):
            room = _room_on_top(thing, base.thing, turn)
            if room.min() >= 0:
                break
        else:
            raise NoRoomError(name)
        top = self._over(thing, base, room, base.z + base.thing.size[2], turn)
        self.done.append(top)
        return top

    def put_in(self, name: str, crate: Placed) -> Placed:
        """Places a thing on the bottom of a crate, apart from what is already in it."""
        thing = make(name, self.rng)
        for _ in range(150):
            turn = float(self.rng.uniform(*ANY_YAW))
            room = _room_on_top(thing, crate.thing, turn) - CRATE_WALL
            if room.min() < 0:
                continue
            candidate = self._over(thing, crate, room, crate.z + CRATE_WALL, turn)
            if self._is_apart(candidate):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(name)

    def _over(self, thing: Thing, base: Placed, room: NDArray[np.float64], z: float, turn: float) -> Placed:
        """Places a thing at height z above `base`, displaced by up to `room` (2,) metres along the base's axes."""
        dx, dy = self.rng.uniform(-room, room)
        c, s = np.cos(base.yaw), np.sin(base.yaw)
        return Placed(thing, base.x + float(c * dx - s * dy), base.y + float(s * dx + c * dy), z, base.yaw + turn)

    def touch(self, name: str, other: Placed) -> Placed:
        """Places a thing side to side with another, a millimetre apart."""
        thing = make(name, self.rng)
        for _ in range(30):
            quarter = int(self.rng.integers(4))
            direction = other.yaw + quarter * np.pi / 2
            reach = (other.thing.size[quarter % 2] + thing.size[quarter % 2]) / 2 + TOUCHING_GAP
            x = other.x + float(np.cos(direction)) * reach
            y = other.y + float(np.sin(direction)) * reach
            candidate = Placed(thing, x, y, other.z, other.yaw)
            if self.free(candidate, self.region, touching=other):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(name)

    def hide(self, name: str, tall: Placed) -> Placed:
        """Places a thing behind a tall one, as seen from the middle of the camera's path (from +x)."""
        thing = make(name, self.rng)
        reach = (max(tall.thing.size[:2]) + max(thing.size[:2])) / 2
        for _ in range(60):
            x = tall.x - reach - float(self.rng.uniform(-0.03, 0.05))
            y = tall.y + float(self.rng.uniform(-0.04, 0.04))
            candidate = Placed(thing, x, y, tall.z, float(self.rng.uniform(*ANY_YAW)))
            if self.free(candidate, self.region):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(name)

    def free(self, candidate: Placed, region: Region, touching: Placed | None = None) -> bool:
        outline = footprint(candidate)
        low, high = outline.min(axis=0), outline.max(axis=0)
        if low[0] < region[0] or high[0] > region[1] or low[1] < region[2] or high[1] > region[3]:
            return False
        return self._is_apart(candidate, touching)

    def _is_apart(self, candidate: Placed, touching: Placed | None = None) -> bool:
        outline = footprint(candidate)
        return all(
            separation(outline, footprint(other)) >= (0 if other is touching else self.gap)
            for other in self.done
            if other.z == candidate.z and _near(candidate, other, self.gap)
        )


def _room_on_top(thing: Thing, base: Thing, turn: float) -> NDArray[np.float64]:
    """How far (2,) a thing, turned by `turn` radians, can move on its base along the base's axes."""
    size, below = np.array(thing.size[:2]), np.array(base.size[:2])
    if base.round:
        return np.full(2, (below[0] - np.hypot(*size)) / 2 / np.sqrt(2))
    c, s = abs(np.cos(turn)), abs(np.sin(turn))
    return np.asarray((below - np.array([[c, s], [s, c]]) @ size) / 2)


def _near(a: Placed, b: Placed, gap: float) -> bool:
    """Whether the bounding circles of the two are less than `gap` apart. Spares most exact tests."""
    reach = (np.hypot(*a.thing.size[:2]) + np.hypot(*b.thing.size[:2])) / 2 * CORNERS
    return bool(np.hypot(a.x - b.x, a.y - b.y) < reach + gap)


def footprint(placed: Placed) -> NDArray[np.float64]:
    """Outline (n, 2) of the thing in the world's x, y: its box's rectangle, or a 16-gon around its circle."""
    half_x, half_y = placed.thing.size[0] / 2, placed.thing.size[1] / 2
    if placed.thing.round:
        angles = np.arange(16) * np.pi / 8
        radius = half_x * CORNERS
        corners = radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    else:
        corners = np.array([[half_x, half_y], [-half_x, half_y], [-half_x, -half_y], [half_x, -half_y]])
    c, s = np.cos(placed.yaw), np.sin(placed.yaw)
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + (placed.x, placed.y), np.float64)


def separation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Widest gap between two convex outlines (n, 2) along their edges' normals. Negative: they overlap.

    It is never more than their distance (separating axis theorem).
    """
    edges = np.concatenate((np.roll(a, -1, axis=0) - a, np.roll(b, -1, axis=0) - b))
    normals = np.stack((edges[:, 1], -edges[:, 0]), axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    on_a, on_b = a @ normals.T, b @ normals.T
    gaps = np.maximum(on_b.min(axis=0) - on_a.max(axis=0), on_a.min(axis=0) - on_b.max(axis=0))
    return float(gaps.max())
