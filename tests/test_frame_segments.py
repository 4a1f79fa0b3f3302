"""Segments of one frame say what fits together, and are seen the same on another lattice."""

from typing import Any

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.frame_segments import FrameSegments
from spot3d.geometry.downsampling import to_lattice

CAMERA = Intrinsics(6.0, 6.0, 3.5, 2.5, 8, 6)


def made(**changes: Any) -> FrameSegments:
    labels = np.zeros(CAMERA.shape, np.uint8)
    labels[1:3, 2:5], labels[4:, 6:] = 1, 2
    fields = {
        "labels": labels,
        "heat": np.array([0.5, 1.0], np.float32),
        "planes": np.array([[0, -1.0, 0, 0.4]]),
        "stands_on": np.array([0, -1], np.int8),
        "camera": CAMERA,
    }
    return FrameSegments(**fields | changes)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"labels": np.zeros((8, 6), np.uint8)}, "labels"),
        ({"labels": np.zeros((6, 8), np.int32)}, "labels"),
        ({"labels": np.full((6, 8), 3, np.uint8)}, "the largest label is 3, but there are 2 segments"),
        ({"heat": np.array([0.5, 1.5], np.float32)}, "heat"),
        ({"heat": np.array([0.5, np.nan], np.float32)}, "heat"),
        ({"heat": np.zeros(256, np.float32), "stands_on": np.zeros(256, np.int8)}, "256 segments"),
        ({"planes": np.zeros((1, 3))}, "planes"),
        ({"planes": np.zeros((33, 4))}, "33 planes"),
        ({"stands_on": np.array([1, 0], np.int8)}, "stands_on"),
        ({"stands_on": np.array([0], np.int8)}, "stands_on"),
    ],
)
def test_what_does_not_fit_together_is_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        made(**changes)


def test_on_its_own_lattice_nothing_changes() -> None:
    segments = made()
    assert len(segments) == 2
    assert segments.seen_by(CAMERA) is segments


def test_on_a_frames_lattice_each_sample_has_its_blocks_label() -> None:
    labels = np.kron(made().labels, np.ones((2, 2), np.uint8))
    full = Intrinsics(12.0, 12.0, 7.5, 5.5, 16, 12)
    blank = np.zeros(full.shape, np.uint8)
    lattice = to_lattice(np.zeros((*full.shape, 3), np.uint8), np.ones(full.shape, np.float32), blank, full, 8).camera
    seen = made(labels=labels, camera=full).seen_by(lattice)
    np.testing.assert_array_equal(seen.labels, made().labels)
    assert seen.camera == lattice


def test_what_lies_outside_is_no_object() -> None:
    wider = Intrinsics(6.0, 6.0, 5.5, 4.5, 12, 10)  # two more pixels on each side
    full = np.ones(CAMERA.shape, np.uint8)
    seen = made(labels=full).seen_by(wider).labels
    assert seen[2:-2, 2:-2].all()
    assert seen.sum() == full.size


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_boxes_are_those_of_the_full_image(factor: int) -> None:
    """Each sample of a lattice stands for a block of pixels."""
    camera = Intrinsics(7.2 * factor, 7.2 * factor, 4.0, 3.25, 8 * factor, 6 * factor)
    blank = np.zeros(camera.shape, np.uint8)
    lattice = to_lattice(np.zeros((*camera.shape, 3), np.uint8), np.ones(camera.shape, np.float32), blank, camera, 8)
    boxes = made(camera=lattice.camera).boxes(camera)
    np.testing.assert_allclose(boxes, factor * np.array([[2, 1, 3, 2], [6, 4, 2, 2]]), atol=1e-9)


@pytest.mark.parametrize(("width", "height"), [(16, 12), (15, 11), (16, 11)])
def test_a_segment_of_all_pixels_is_the_whole_image(width: int, height: int) -> None:
    """Also where the last blocks are cut off by the image's rim."""
    camera = Intrinsics(12.0, 12.0, 7.5, 5.5, width, height)
    blank = np.zeros(camera.shape, np.uint8)
    lattice = to_lattice(np.zeros((*camera.shape, 3), np.uint8), np.ones(camera.shape, np.float32), blank, camera, 8)
    assert lattice.camera.shape == (6, 8)
    boxes = made(camera=lattice.camera, labels=np.full((6, 8), 2, np.uint8)).boxes(camera)
    np.testing.assert_allclose(boxes, [[0, 0, 0, 0], [0, 0, width, height]], atol=1e-9)


def test_boxes_on_the_image_of_every_second_pixel() -> None:
    full = Intrinsics(12.0, 12.0, 7.5, 5.5, 16, 12)
    boxes = made(camera=full, labels=np.kron(made().labels, np.ones((2, 2), np.uint8))).boxes(full.halved())
    np.testing.assert_allclose(boxes[0], [2.25, 1.25, 3, 2], atol=1e-9)
