"""Things on a desk: flat, thin and composed ones. Those with a front face +x."""

import numpy as np

from spot3d.source.scene.recipes import Recipe, block
from spot3d.source.scene.shapes import (
    BOX,
    CHECKS,
    CONE,
    COVER,
    ELLIPSOID,
    PICTURE,
    PLAIN,
    SPECKLE,
    STRIPES,
    Colour,
    Primitive,
    Texture,
    Vector,
)

BLACK: Colour = (0.10, 0.10, 0.11)
GREY: Colour = (0.36, 0.37, 0.39)
PAPER: Colour = (0.84, 0.84, 0.82)


def _tilted(degrees: float) -> tuple[Vector, Vector, Vector]:
    """Rotation about y that leans the top of an upright thing towards -x."""
    c, s = float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees)))
    return (c, 0.0, -s), (0.0, 1.0, 0.0), (s, 0.0, c)


def _monitor(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    half_width, half_height, middle = 0.255 * scale, 0.155 * scale, 0.29 * scale
    case, picture = Texture(PLAIN, BLACK), Texture(PICTURE, first, second, 0.09)
    return [
        Primitive(BOX, (0.11 * scale, 0.13 * scale, 0.008), case),
        Primitive(BOX, (0.014, 0.03, 0.14 * scale), case, (-0.03, 0, 0.14 * scale)),
        Primitive(BOX, (0.02, half_width, half_height), case, (0, 0, middle)),
        Primitive(BOX, (0.002, half_width - 0.012, half_height - 0.012), picture, (0.02, 0, middle)),
    ]


def _laptop(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    half_width, half_depth, lean = 0.165 * scale, 0.115 * scale, 18.0
    rise, back = half_depth * np.cos(np.radians(lean)), half_depth * np.sin(np.radians(lean))
    x, z, picture = -half_depth - float(back), float(rise), Texture(PICTURE, first, second, 0.06)
    return [
        Primitive(BOX, (half_depth, half_width, 0.009), Texture(CHECKS, GREY, BLACK, 0.03)),
        Primitive(BOX, (0.004, half_width, half_depth), Texture(PLAIN, GREY), (x, 0.0, z), _tilted(lean)),
        Primitive(BOX, (0.001, half_width - 0.01, half_depth - 0.012), picture, (x + 0.004, 0.0, z), _tilted(lean)),
    ]


def _lamp(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    height, reach = 0.38 * scale, 0.10 * scale
    surface, pole = Texture(PLAIN, first), Texture(PLAIN, second)
    return [
        Primitive(CONE, (0.012, 0.085 * scale, 0.08 * scale, 0.0), surface),
        Primitive(CONE, (height / 2, 0.013, 0.013, 0.0), pole, (0, 0, height / 2)),
        Primitive(BOX, (reach / 2, 0.013, 0.013), pole, (reach / 2, 0, height)),
        Primitive(CONE, (0.05 * scale, 0.08 * scale, 0.035 * scale, 0.0), surface, (reach, 0, height)),
    ]


def _mouse(scale: float, first: Colour, _second: Colour) -> list[Primitive]:
    form = (0.056 * scale, 0.031 * scale, 0.036 * scale, 0.0, 0.036 * scale, 0.0)
    return [Primitive(ELLIPSOID, form, Texture(SPECKLE, BLACK, first, 0.02))]


def _telephone(scale: float, first: Colour, second: Colour) -> list[Primitive]:
    return [
        Primitive(BOX, (0.105 * scale, 0.085 * scale, 0.02 * scale), Texture(CHECKS, first, second, 0.025)),
        Primitive(BOX, (0.10 * scale, 0.023, 0.014), Texture(PLAIN, BLACK), (0, -0.055 * scale, 0.034 * scale)),
    ]


def _punch(scale: float, first: Colour, _second: Colour) -> list[Primitive]:
    return [
        Primitive(BOX, (0.05 * scale, 0.065 * scale, 0.012), Texture(PLAIN, BLACK)),
        Primitive(BOX, (0.035 * scale, 0.05 * scale, 0.025), Texture(PLAIN, first), (0, 0, 0.035)),
    ]


OFFICE: dict[str, Recipe] = {
    "monitor": _monitor,
    "laptop": _laptop,
    "lamp": _lamp,
    "keyboard": block(0.145, 0.44, 0.026, CHECKS, 0.019),
    "mouse": _mouse,
    "telephone": _telephone,
    "punch": _punch,
    "stapler": block(0.15, 0.038, 0.055, STRIPES, 0.03),
    "letter tray": block(0.25, 0.33, 0.065, STRIPES, 0.03),
    "ring binder": block(0.28, 0.075, 0.31, COVER, 0.05),
    "paper stack": lambda scale, _first, second: block(0.21, 0.297, 0.03, SPECKLE, 0.02)(scale, PAPER, second),
}
