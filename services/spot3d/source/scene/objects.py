"""The things of the built-in scenes: everyday objects, made of primitives."""

from dataclasses import dataclass, replace

import numpy as np

from spot3d.source.scene.office import OFFICE
from spot3d.source.scene.recipes import Recipe, block, turned
from spot3d.source.scene.shapes import (
    BOX,
    CHECKS,
    CONE,
    COVER,
    ELLIPSOID,
    LABEL,
    PLAIN,
    SPECKLE,
    STRIPES,
    WOOD,
    Colour,
    Primitive,
    Texture,
    Vector,
)

PALETTE: tuple[Colour, ...] = (
    (0.70, 0.10, 0.08),
    (0.08, 0.22, 0.55),
    (0.85, 0.62, 0.10),
    (0.10, 0.42, 0.18),
    (0.82, 0.80, 0.76),
    (0.38, 0.10, 0.35),
    (0.10, 0.45, 0.50),
    (0.82, 0.35, 0.08),
    (0.16, 0.16, 0.18),
)
CRATE_WALL = 0.01
LYING = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Thing:
    """An object in its own frame, whose origin is the centre of its box's base. size: of the box, metres."""

    name: str
    parts: tuple[Primitive, ...]
    size: Vector
    round: bool


def make(name: str, rng: np.random.Generator) -> Thing:
    """The named thing, with its size varied by up to 12 % and its colours drawn by `rng`."""
    first, second = rng.choice(len(PALETTE), 2, replace=False)
    scale = float(rng.uniform(0.88, 1.12))
    parts = CATALOGUE[name](scale, PALETTE[first], PALETTE[second])
    bounds = np.array([part.bounds() for part in parts])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    moved = []
    for part in parts:
        x, y, z = (float(value) for value in np.array(part.centre) - origin)
        moved.append(replace(part, centre=(x, y, z)))
    width, depth, height = (float(value) for value in high - low)
    return Thing(name, tuple(moved), (width, depth, height), name in ROUND)


def _mug(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    surface = Texture(STRIPES, first, second, 0.03)
    bar = Texture(PLAIN, first)
    cup = Primitive(CONE, (0.048 * scale, 0.039 * scale, 0.042 * scale, 1.0), surface)
    reach, thick = 0.041 * scale, 0.006
    upper = Primitive(BOX, (0.014, thick, thick), bar, (reach + 0.012, 0, 0.026 * scale))
    lower = Primitive(BOX, (0.014, thick, thick), bar, (reach + 0.012, 0, -0.026 * scale))
    grip = Primitive(BOX, (thick, thick, 0.026 * scale + thick), bar, (reach + 0.022, 0, 0))
    return [cup, upper, lower, grip]


def _pot(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    radius, half = 0.085 * scale, 0.05 * scale
    bar = Texture(PLAIN, (0.12, 0.12, 0.13))
    ears = [Primitive(BOX, (0.018, 0.022, 0.006), bar, (side * (radius + 0.012), 0, 0.03)) for side in (-1, 1)]
    return [Primitive(CONE, (half, radius, radius, 1.0), Texture(SPECKLE, first, second, 0.02)), *ears]


def _bottle(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    radius, body, neck = 0.036 * scale, 0.075 * scale, 0.045 * scale
    return [
        Primitive(CONE, (body, radius, radius, 0.0), Texture(LABEL, first, second, 0.04)),
        Primitive(CONE, (neck, radius, 0.014, 0.0), Texture(PLAIN, first), (0, 0, body + neck)),
        Primitive(CONE, (0.012, 0.015, 0.015, 0.0), Texture(PLAIN, second), (0, 0, body + 2 * neck + 0.012)),
    ]


def _bowl(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    form = (0.082 * scale, 0.082 * scale, 0.07 * scale, -0.062 * scale, 0.0, 1.0)
    return [Primitive(ELLIPSOID, form, Texture(STRIPES, first, second, 0.024))]


def _ball(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    r = 0.055 * scale
    return [Primitive(ELLIPSOID, (r, r, r, -r, r, 0.0), Texture(CHECKS, first, second, 0.06))]


def _melon(scale: float, _first: Colour, _second: Colour) -> list[Primitive]:
    a, b, c = 0.105 * scale, 0.075 * scale, 0.072 * scale
    surface = Texture(STRIPES, (0.12, 0.36, 0.10), (0.55, 0.62, 0.22), 0.05)
    return [Primitive(ELLIPSOID, (a, b, c, -0.97 * c, c, 0.0), surface)]


def _vase(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    r, c, neck = 0.06 * scale, 0.075 * scale, 0.03 * scale
    low, high = -0.8 * c, 0.8 * c
    return [
        Primitive(ELLIPSOID, (r, r, c, low, high, 0.0), Texture(SPECKLE, first, second, 0.03)),
        Primitive(CONE, (neck, 0.6 * r, 0.75 * r, 1.0), Texture(PLAIN, second), (0, 0, high + neck)),
    ]


def _roll(scale: float, _first: Colour, second: Colour) -> list[Primitive]:
    form = (0.11 * scale, 0.055 * scale, 0.055 * scale, 0.0)
    return [Primitive(CONE, form, Texture(SPECKLE, (0.85, 0.84, 0.80), second, 0.03), (0, 0, 0), LYING)]


def _stool(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    half, leg, surface = 0.16 * scale, 0.20 * scale, Texture(PLAIN, first)
    legs = [Primitive(BOX, (0.015, 0.015, leg), surface, (x, y, -0.02)) for x in (-0.13, 0.13) for y in (-0.13, 0.13)]
    return [Primitive(BOX, (half, half, 0.02), Texture(PLAIN, second), (0, 0, leg)), *legs]


def _open_box(half_depth: float, half_width: float, half_height: float) -> Recipe:
    """A bottom and four walls; half sizes in metres."""

    def parts(scale: float, first: Colour, _second: Colour) -> list[Primitive]:
        depth, width, half = half_depth * scale, half_width * scale, half_height * scale
        surface, thick = Texture(PLAIN, first), CRATE_WALL / 2
        ends = [Primitive(BOX, (thick, width, half), surface, (side * (depth - thick), 0, 0)) for side in (-1, 1)]
        sides = [Primitive(BOX, (depth, thick, half), surface, (0, side * (width - thick), 0)) for side in (-1, 1)]
        return [Primitive(BOX, (depth, width, thick), surface, (0, 0, thick - half)), *ends, *sides]

    return parts


CATALOGUE: dict[str, Recipe] = {
    "cereal box": block(0.19, 0.07, 0.28, LABEL, 0.05),
    "shoe box": block(0.29, 0.18, 0.11, PLAIN, 0.05),
    "book": block(0.16, 0.22, 0.028, COVER, 0.05),
    "dictionary": block(0.15, 0.21, 0.055, COVER, 0.05),
    "milk carton": block(0.072, 0.072, 0.20, LABEL, 0.05),
    "tea box": block(0.13, 0.08, 0.075, LABEL, 0.03),
    "sugar pack": block(0.10, 0.065, 0.15, LABEL, 0.04),
    "puzzle cube": block(0.06, 0.06, 0.06, CHECKS, 0.02),
    "speaker": block(0.13, 0.14, 0.21, SPECKLE, 0.02),
    "tin can": turned(0.11, 0.038, 0.038, False, LABEL, 0.04),
    "jar": turned(0.10, 0.05, 0.05, False, LABEL, 0.04),
    "biscuit tin": turned(0.07, 0.09, 0.09, False, CHECKS, 0.04),
    "flower pot": turned(0.12, 0.045, 0.065, True, PLAIN, 0.04),
    "cone": turned(0.15, 0.06, 0.012, False, STRIPES, 0.05),
    "mug": _mug,
    "pot": _pot,
    "bottle": _bottle,
    "bowl": _bowl,
    "ball": _ball,
    "melon": _melon,
    "vase": _vase,
    "paper roll": _roll,
    "crate": _open_box(0.115, 0.17, 0.035),
    "bin": _open_box(0.19, 0.26, 0.07),
    "chest": block(0.38, 0.52, 0.44, WOOD, 0.12),
    "stool": _stool,
    **OFFICE,
}
ROUND = frozenset(("tin can", "jar", "biscuit tin", "flower pot", "cone", "bottle", "bowl", "ball", "vase"))
