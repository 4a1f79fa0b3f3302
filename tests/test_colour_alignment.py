"""Colour that lies off depth is told, and what only looks like it is not."""

import numpy as np
import pytest

from spot3d.colour_alignment import AlignmentWatch, ColourAlignment
from spot3d.frame import RgbdFrame
from spot3d.source.sequences import open_source

FRAMES = [open_source("scene:1:room", 360)[index] for index in range(0, 360, 30)]
"""12 frames of 640 x 480 over 12 s."""


def shifted(frame: RgbdFrame, right: int, down: int) -> np.ndarray:
    """Colour as it would be seen from beside depth; the border goes round."""
    return np.roll(frame.colour, (down, right), axis=(0, 1))


def aligned(right: int, down: int, frames: int = 12) -> ColourAlignment:
    alignment = ColourAlignment()
    for frame in FRAMES[:frames]:
        alignment.add(shifted(frame, right, down), frame.depth_metres())
    return alignment


@pytest.mark.parametrize(("right", "down"), [(0, 0), (4, 0), (0, -4), (-4, 4), (8, 0)])
def test_colour_on_depth_is_not_told(right: int, down: int) -> None:
    assert aligned(right, down).offset() is None


@pytest.mark.parametrize(("right", "down"), [(16, 0), (-16, 4), (0, 16), (0, -32), (32, 0), (-24, -24)])
def test_colour_off_depth_is_told_with_its_offset(right: int, down: int) -> None:
    found = aligned(right, down).offset()
    assert found is not None
    assert np.abs(np.subtract(found, (right, down))).max() <= 2
    assert aligned(right, down, frames=11).offset() is None, "too few to be sure"


def test_how_well_colour_lies_on_depth_is_a_number() -> None:
    assert aligned(0, 0).on_depth() > 2 * aligned(24, 0).on_depth()
    assert ColourAlignment().on_depth() == 0


@pytest.mark.parametrize("kind", ["swapped", "noise", "black", "hot", "another's", "stripes"])
def test_colour_that_says_nothing_of_where_it_lies_is_not_told(kind: str) -> None:
    alignment, rng = ColourAlignment(), np.random.default_rng(1)
    stripes = np.broadcast_to(np.uint8(200) * (np.arange(640) // 25 % 2)[None, :, None].astype(np.uint8), (480, 640, 3))
    hot = np.zeros((480, 640, 3), np.uint8)
    hot[200:202, 300:302] = 255
    for frame, other in zip(FRAMES, FRAMES[6:] + FRAMES[:6], strict=True):
        colour = {
            "swapped": frame.colour[..., ::-1],
            "noise": rng.integers(0, 255, frame.colour.shape, np.uint8),
            "black": np.zeros_like(frame.colour),
            "hot": hot,
            "another's": other.colour,
            "stripes": stripes,
        }[kind]
        alignment.add(np.ascontiguousarray(colour), frame.depth_metres())
    assert alignment.frames == 12
    assert alignment.offset() is None


@pytest.mark.parametrize("shape", [(1, 1), (12, 16), (3, 640), (640, 3), (40, 320)])
def test_images_of_any_size_are_taken(shape: tuple[int, int]) -> None:
    alignment = ColourAlignment()
    for _ in range(12):
        alignment.add(np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32))
    assert alignment.offset() is None
    assert alignment.on_depth() == 0


def test_another_size_begins_anew() -> None:
    alignment = aligned(32, 0)
    alignment.add(FRAMES[0].colour[::2, ::2].copy(), FRAMES[0].depth_metres()[::2, ::2].copy())
    assert alignment.frames == 1


def test_a_watch_says_it_once_and_looks_at_few() -> None:
    watch = AlignmentWatch()
    said = []
    for frame in FRAMES:
        off = RgbdFrame(frame.stamp_ns, shifted(frame, 24, -16), frame.depth, frame.depth_scale, frame.intrinsics)
        said += [watch.look(off) for _ in range(20)]
    (told,) = filter(None, said)
    assert told.startswith("colour lies off depth, by about 24 pixels right and 16 pixels up: ")
    assert "calibration.json" in told
    assert said.index(told) == 119, "one in ten is looked at, and twelve are enough"
