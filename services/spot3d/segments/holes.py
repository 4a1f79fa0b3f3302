"""Fill holes in depth that belong to an object by its colour and borders: shiny or dark surfaces.

Two parts of one colour and height with a hole of the same colour between them are one object. Pixels of a hole that
differ in colour from the support around it belong to the object beside them. The rest of the hole is divided along the
edges of the colour image by watershed (F. Meyer, *Color image segmentation*, 1992).
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.segments.labels import pixels_of, united

_COLOUR = 0.2
"""Pixels that differ by this from a support are not of it, RGB in [0, 1], L2 norm: eps_I. 0.3 gives the same boxes."""
_PIXELS = 20
"""A hole, or the support around it, with fewer pixels is not judged by colour."""
_AROUND = 5
"""Colour and height of what is beside a hole are taken this near to it, pixels."""
_DEEP = 0.05
"""Watershed fills a hole this far from an object, metres: beyond, as at an image's border, nothing is known. Success
and detection with 2.5, 5, 10 cm: on HOTS 0.90, 0.93; 0.91, 0.94; 0.92, 0.94; in a room 0.85, 0.83; 0.85, 0.83; 0.84,
0.83; on OSD and in clutter the same."""

_STEP = 0.01
"""Parts at one height differ by less beside a hole, metres. From 0.5 to 5 cm single frames of HOTS and OSD are the
same; without a limit OSD's detection is 0.93 instead of 0.99, as neighbours of one colour become one."""


def fill_holes(
    labels: NDArray[np.int32], depth: NDArray[np.float32], colour: NDArray[np.uint8], focal: float
) -> NDArray[np.int32]:
    """The labels extended to pixels without depth that belong to an object.

    labels: (h, w) int32, 0 = no object; depth: (h, w) float32 metres, 0 = invalid; colour: (h, w, 3) uint8;
    focal: pixels. Pixels with depth keep their labels. Pixels without depth at the image's border are background, which
    is out of the sensor's range.
    """
    valid = depth > 0
    if valid.all() or not labels.any():
        return labels
    seeds = labels.copy()
    for piece in _other_colours(seeds, valid, colour):
        if len(piece.beside) == 1:  # between two objects watershed decides
            seeds[piece.window][piece.mask] = piece.beside[0]
    objects = seeds > 0
    near = cv2.dilate(objects.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    within = cv2.distanceTransform((~objects).astype(np.uint8), cv2.DIST_L2, 5)
    deep = _DEEP * focal / float(np.median(depth[(labels > 0) & valid]))
    bare = (valid & ~near) | (within > deep)
    for rim in (np.s_[1], np.s_[-2], np.s_[:, 1], np.s_[:, -2]):  # watershed ignores the outermost pixels
        bare[rim] |= ~valid[rim]
    flooded = cv2.watershed(np.ascontiguousarray(colour), np.where(objects, seeds + 1, bare).astype(np.int32))
    return np.where(valid, labels, np.maximum(flooded - 1, 0)).astype(np.int32)


def join_across_holes(
    parts: list[NDArray[np.int64]], depth: NDArray[np.float32], colour: NDArray[np.uint8], height: NDArray[np.float32]
) -> list[NDArray[np.int64]]:
    """The parts after joining those of one colour and height that a hole of this colour divides: a black keyboard.

    Parts that touch stay apart: there depth tells one from the other.
    parts: flat pixel indices; depth, colour: see `fill_holes`; height: (h, w) float32 metres above the support.
    """
    labels, valid, pairs = np.zeros(depth.shape, np.int32), depth > 0, []
    for number, pixels in enumerate(parts):
        labels.ravel()[pixels] = number + 1
    for piece in _other_colours(labels, valid, colour):
        if len(piece.beside) < 2:
            continue
        own = np.median(colour[piece.window][piece.mask], axis=0)
        rim = np.where(_grown(piece.mask, _AROUND) & valid[piece.window], labels[piece.window], 0)
        beside = {
            number: float(np.median(height[piece.window][rim == number]))
            for number in piece.beside.tolist()
            if np.linalg.norm(np.median(colour[piece.window][rim == number], axis=0) - own) < 255 * _COLOUR
        }
        pairs += [
            (a - 1, b - 1)
            for a, b in combinations(beside, 2)
            if abs(beside[a] - beside[b]) < _STEP and not (_grown(rim == a, 1) & (rim == b)).any()
        ]
    return pixels_of(united(labels - 1, np.array(pairs, np.int64).reshape(-1, 2), len(parts)))


class _Piece(NamedTuple):
    """A piece of a hole. window: the part of the image around it; mask: (h, w) bool, its pixels there; beside: (n,)
    labels of the objects that touch it."""

    window: tuple[slice, slice]
    mask: NDArray[np.bool_]
    beside: NDArray[np.int32]


def _other_colours(labels: NDArray[np.int32], valid: NDArray[np.bool_], colour: NDArray[np.uint8]) -> Iterator[_Piece]:
    """The pieces of holes beside objects whose colour is not that of the support around the hole."""
    count, hole, boxes, _ = cv2.connectedComponentsWithStats((~valid).astype(np.uint8), connectivity=4)
    h, w = valid.shape
    for number in range(1, count):
        x, y, width, height, pixels = boxes[number]
        inner = x > 0 and y > 0 and x + width < w and y + height < h  # beyond the image's border nothing is known
        if pixels < _PIXELS or not inner:
            continue
        window = np.s_[max(0, y - _AROUND) : y + height + _AROUND, max(0, x - _AROUND) : x + width + _AROUND]
        own, mine = hole[window] == number, labels[window]
        support = _grown(own, _AROUND) & valid[window] & (mine == 0)
        if np.count_nonzero(support) < _PIXELS or not (_grown(own, 1) & (mine > 0)).any():
            continue
        rgb = colour[window].astype(np.float32) / 255
        other = own & (np.linalg.norm(rgb - np.median(rgb[support], axis=0), axis=2) > _COLOUR)
        pieces, piece = cv2.connectedComponents(other.astype(np.uint8), connectivity=4)
        for index in range(1, pieces):
            mask = piece == index
            yield _Piece(window, mask, np.unique(mine[_grown(mask, 1) & (mine > 0)]))


def _grown(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    size = 2 * pixels + 1
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)
