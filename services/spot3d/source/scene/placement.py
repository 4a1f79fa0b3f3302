"""Where the things stand: seeded, without interpenetration, some touching, hidden or stacked on purpose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.source.scene.objects import Thing, make

# Regions (x from, x to, y from, y to) and height of the two supports' upper sides, in metres, world frame.
TABLE_HEIGHT, SHELF_HEIGHT = 0.75, 0.98
TABLE_REGION = (-0.20, 0.37, -0.66, 0.66)
FRONT_REGION = (0.0, 0.37, -0.66, 0.66)
SHELF_REGION = (-0.46, -0.22, -0.56, 0.56)
TOUCHING_GAP = 0.001
# A round thing is outlined by a 16-gon around it.
CORNERS = 1 / np.cos(np.pi / 16)
CURVED = ("bowl", "ball", "melon")
TURNED = ("jar", "flower pot", "cone", "paper roll")
FREE = ("pot", "dictionary", "biscuit tin", "tea box", "paper roll", "ball", "jar")
SMALL = ("puzzle cube", "tin can", "tea box", "mug")
SQUARE = ("milk carton", "tea box", "sugar pack", "tin can", "speaker")
TALL = ("cereal box", "bottle", "speaker")
ON_SHELF = ("jar", "vase", "tin can", "sugar pack", "mug", "puzzle cube")


@dataclass(frozen=True, slots=True)
class Placed:
    """A thing standing at (x, y) with its base at height z, turned by yaw (radians)."""

    thing: Thing
    x: float
    y: float
    z: float
    yaw: float


class NoRoomError(Exception):
    """A thing found no free place; the arrangement is drawn anew."""


def arrange(seed: int, cluttered: bool) -> list[Placed]:
    """Places 12 things, or 18 to 24 cluttered, by the seed alone, two or three of them on the shelf.

    Always: one flat, one stacked, two touching, one hidden behind a tall one.
    """
    for attempt in range(1000):
        rng = np.random.default_rng((seed, int(cluttered), attempt))
        try:
            return _Arrangement(rng, gap=0.012 if cluttered else 0.03).fill(cluttered)
        except NoRoomError:
            continue
    raise RuntimeError(f"seed {seed}: no arrangement found in 1000 attempts")


class _Arrangement:
    def __init__(self, rng: np.random.Generator, gap: float) -> None:
        self.rng = rng
        self.gap = gap
        self.done: list[Placed] = []

    def fill(self, cluttered: bool) -> list[Placed]:
        rng = self.rng
        for tall in rng.choice(TALL, 2 if cluttered else 1, replace=False):
            self.hide("mug", self.stand(str(tall), FRONT_REGION))
        for name in ("shoe box", "biscuit tin") if cluttered else ("shoe box",):
            base = self.stand(name)
            top = self.stack(str(rng.choice(SMALL[:3])), base)
            if cluttered and top.thing.name == "tea box":
                self.stack("puzzle cube", top)
        for first, second in rng.permutation(SQUARE)[: 4 if cluttered else 2].reshape(-1, 2):
            self.touch(str(second), self.stand(str(first)))
        self.stand("book")
        self.stand(str(rng.choice(CURVED)))
        self.stand(str(rng.choice(TURNED)))
        for name in rng.choice(FREE, int(rng.integers(2, 5)) if cluttered else 1, replace=False):
            self.stand(str(name))
        for name in rng.choice(ON_SHELF, 3 if cluttered else 2, replace=False):
            self.stand(str(name), SHELF_REGION, SHELF_HEIGHT)
        return self.done

    def stand(
        self,
        name: str,
        region: tuple[float, float, float, float] = TABLE_REGION,
        height: float = TABLE_HEIGHT,
    ) -> Placed:
        thing = make(name, self.rng)
        for _ in range(150):
            x, y = self.rng.uniform(region[0], region[1]), self.rng.uniform(region[2], region[3])
            candidate = Placed(thing, float(x), float(y), height, float(self.rng.uniform(-np.pi, np.pi)))
            if self.free(candidate, region):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(name)

    def stack(self, name: str, base: Placed) -> Placed:
        """Stands a thing on another, its whole base on the other's top."""
        thing = make(name, self.rng)
        for turn in (float(self.rng.uniform(-0.6, 0.6)), 0.0):
            room = _room_on_top(thing, base.thing, turn)
            if room.min() >= 0:
                break
        else:
            raise NoRoomError(name)
        dx, dy = self.rng.uniform(-room, room)
        c, s = np.cos(base.yaw), np.sin(base.yaw)
        top = Placed(
            thing,
            base.x + float(c * dx - s * dy),
            base.y + float(s * dx + c * dy),
            base.z + base.thing.size[2],
            base.yaw + turn,
        )
        self.done.append(top)
        return top

    def touch(self, name: str, other: Placed) -> Placed:
        """Slides a thing up to another until a millimetre is left between them, side to side."""
        thing = make(name, self.rng)
        for _ in range(30):
            quarter = int(self.rng.integers(4))
            direction = other.yaw + quarter * np.pi / 2
            reach = (other.thing.size[quarter % 2] + thing.size[quarter % 2]) / 2 + TOUCHING_GAP
            x = other.x + float(np.cos(direction)) * reach
            y = other.y + float(np.sin(direction)) * reach
            candidate = Placed(thing, x, y, other.z, other.yaw)
            if self.free(candidate, TABLE_REGION, touching=other):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(name)

    def hide(self, name: str, tall: Placed) -> Placed:
        """Stands a thing behind a tall one, as seen from the middle of the camera's path (from +x)."""
        thing = make(name, self.rng)
        reach = (max(tall.thing.size[:2]) + max(thing.size[:2])) / 2
        for _ in range(60):
            x = tall.x - reach - float(self.rng.uniform(-0.03, 0.05))
            y = tall.y + float(self.rng.uniform(-0.04, 0.04))
            candidate = Placed(thing, x, y, tall.z, float(self.rng.uniform(-np.pi, np.pi)))
            if self.free(candidate, TABLE_REGION):
                self.done.append(candidate)
                return candidate
        raise NoRoomError(name)

    def free(
        self,
        candidate: Placed,
        region: tuple[float, float, float, float],
        touching: Placed | None = None,
    ) -> bool:
        outline = footprint(candidate)
        low, high = outline.min(axis=0), outline.max(axis=0)
        if low[0] < region[0] or high[0] > region[1] or low[1] < region[2] or high[1] > region[3]:
            return False
        return all(
            separation(outline, footprint(other)) >= (0 if other is touching else self.gap)
            for other in self.done
            if other.z == candidate.z and _near(candidate, other, self.gap)
        )


def _room_on_top(thing: Thing, base: Thing, turn: float) -> NDArray[np.float64]:
    """How far (2,) a thing, turned by `turn` radians, can move on its base, along the base's axes."""
    size, below = np.array(thing.size[:2]), np.array(base.size[:2])
    if base.round:
        return np.full(2, (below[0] - np.hypot(*size)) / 2 / np.sqrt(2))
    c, s = abs(np.cos(turn)), abs(np.sin(turn))
    return np.asarray((below - np.array([[c, s], [s, c]]) @ size) / 2)


def _near(a: Placed, b: Placed, gap: float) -> bool:
    """Whether circles around the two leave less than `gap` between them; spares most exact tests."""
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
    """Widest gap between two convex outlines (n, 2) along their edges' normals; negative: overlap.

    Never more than their distance (separating axis theorem).
    """
    edges = np.concatenate((np.roll(a, -1, axis=0) - a, np.roll(b, -1, axis=0) - b))
    normals = np.stack((edges[:, 1], -edges[:, 0]), axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    on_a, on_b = a @ normals.T, b @ normals.T
    gaps = np.maximum(on_b.min(axis=0) - on_a.max(axis=0), on_a.min(axis=0) - on_b.max(axis=0))
    return float(gaps.max())
