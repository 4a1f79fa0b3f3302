"""Surfaces that several built-in scenes have: wood, cloth and walls."""

from spot3d.source.scene.shapes import SPECKLE, TILES, WOOD, Colour, Texture

_OAK: Colour = (0.52, 0.34, 0.18)
_PALE: Colour = (0.66, 0.52, 0.34)
_DARK: Colour = (0.22, 0.14, 0.09)

OAK = Texture(WOOD, _OAK, _DARK, 0.09)
PALE = Texture(WOOD, _PALE, _OAK, 0.12)
DARK = Texture(WOOD, _DARK, _OAK, 0.1)
CLOTH = Texture(SPECKLE, (0.25, 0.30, 0.38), (0.42, 0.44, 0.46), 0.05)
TILED = Texture(TILES, (0.62, 0.63, 0.60), (0.50, 0.53, 0.54), 0.20)
PLASTER = Texture(SPECKLE, (0.70, 0.69, 0.66), (0.66, 0.66, 0.64), 0.05)
