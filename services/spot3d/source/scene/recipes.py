"""Recipes that make things from primitives, given a scale and two colours."""

from collections.abc import Callable

from spot3d.source.scene.shapes import BOX, CONE, Colour, Primitive, Texture

Recipe = Callable[[float, Colour, Colour], list[Primitive]]


def block(width: float, depth: float, height: float, pattern: int, period: float) -> Recipe:
    """A box of these sizes along x, y and z (metres)."""

    def parts(scale: float, first: Colour, second: Colour) -> list[Primitive]:
        half = (width * scale / 2, depth * scale / 2, height * scale / 2)
        return [Primitive(BOX, half, Texture(pattern, first, second, period))]

    return parts


def turned(height: float, bottom: float, top: float, opened: bool, pattern: int, period: float) -> Recipe:
    """A truncated cone of this height and these radii (metres), open at its top or not."""

    def parts(scale: float, first: Colour, second: Colour) -> list[Primitive]:
        form = (height * scale / 2, bottom * scale, top * scale, float(opened))
        return [Primitive(CONE, form, Texture(pattern, first, second, period))]

    return parts
