import numpy as np
import pytest
from scenes import camera, overlaps, squares

from spot3d.boxes import iou_matrix_2d
from spot3d.camera import Intrinsics
from spot3d.proposals.propose import propose
from spot3d.proposals.settings import PAPER, ProposalSettings

LEFT, RIGHT = (60, 70, 70, 90), (190, 100, 60, 60)


@pytest.mark.parametrize(
    ("objects", "with_depth"),
    [
        ((), True),
        ((), False),
        ((LEFT,), True),
        ((LEFT,), False),
        ((LEFT, RIGHT), True),
        ((LEFT, RIGHT), False),
    ],
)
def test_the_best_boxes_are_the_objects(objects, with_depth):
    colour, depth = squares(*objects)
    boxes = propose(colour, depth if with_depth else np.zeros_like(depth), camera(), ProposalSettings())
    assert boxes.dtype == np.float32
    assert boxes.shape[1] == 5
    assert (boxes.size == 0) == (not objects)
    for one in objects:
        assert overlaps(boxes[: 5 * len(objects)], one).max() > 0.7


def test_boxes_of_a_large_image_are_in_its_own_pixels():
    colour, depth = (image.repeat(2, 0).repeat(2, 1) for image in squares(LEFT, RIGHT))
    small = camera()
    large = Intrinsics(2 * small.fx, 2 * small.fy, 2 * small.cx + 0.5, 2 * small.cy + 0.5, 640, 480)
    boxes = propose(colour, depth, large, ProposalSettings())
    for one in (LEFT, RIGHT):
        assert overlaps(boxes[:10], tuple(2 * side for side in one)).max() > 0.7


@pytest.mark.parametrize(("width", "height"), [(4000, 11), (8192, 1), (480, 1), (4000, 13)])
def test_a_wide_low_image_without_edges_has_no_boxes(width, height):
    wide = Intrinsics(0.9 * width, 0.9 * width, width / 2, height / 2, width, height)
    boxes = propose(np.zeros((*wide.shape, 3), np.uint8), np.ones(wide.shape, np.float32), wide, ProposalSettings())
    assert boxes.shape == (0, 5)


def textured_frame():
    rng = np.random.default_rng(3)
    colour, depth = squares(LEFT, RIGHT, (20, 180, 40, 50))
    return np.clip(colour + rng.normal(0, 25, colour.shape), 0, 255).astype(np.uint8), depth


@pytest.mark.parametrize("most", [1, 7, 200])
def test_boxes_lie_in_the_image_sorted_and_no_more_than_asked_for(most):
    colour, depth = textured_frame()
    boxes = propose(colour, depth, camera(), ProposalSettings(max_boxes=most))
    assert 0 < len(boxes) <= most
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 0] + boxes[:, 2] <= 320).all()
    assert (boxes[:, 1] + boxes[:, 3] <= 240).all()
    assert (boxes[:, 2:4] > 0).all()
    assert (np.diff(boxes[:, 4]) <= 0).all()
    assert boxes[-1, 4] > 0.01


def test_same_frame_same_boxes_and_inputs_untouched():
    colour, depth = textured_frame()
    before = colour.copy(), depth.copy()
    first = propose(colour, depth, camera(), ProposalSettings(max_boxes=100))
    np.testing.assert_array_equal(first, propose(colour, depth, camera(), ProposalSettings(max_boxes=100)))
    np.testing.assert_array_equal(colour, before[0])
    np.testing.assert_array_equal(depth, before[1])


def test_first_come_boxes_that_lie_apart_then_the_others():
    colour, depth = textured_frame()
    by_score = propose(colour, depth, camera(), ProposalSettings(apart=1.0))
    assert (np.diff(by_score[:, 4]) <= 0).all()
    boxes = propose(colour, depth, camera(), ProposalSettings())
    np.testing.assert_array_equal(boxes[np.lexsort(boxes.T)], by_score[np.lexsort(by_score.T)])
    iou = iou_matrix_2d(boxes, boxes)
    best = np.array([iou[k, :k].max(initial=0) for k in range(len(boxes))])
    apart = int(np.argmax(best > 0.5))
    assert 1 < apart < len(boxes)
    assert (iou[apart:, :apart].max(axis=1) > 0.5).all()
    for run in (boxes[:apart], boxes[apart:]):
        assert (np.diff(run[:, 4]) <= 0).all()
    few = propose(colour, depth, camera(), ProposalSettings(max_boxes=5))
    np.testing.assert_array_equal(few, boxes[:5])


def test_no_two_boxes_overlap_by_more_than_beta():
    boxes = propose(*textured_frame(), camera(), ProposalSettings(max_boxes=150, beta=0.6))
    for k, (x, y, w, h, _) in enumerate(boxes):
        assert overlaps(boxes[k + 1 :], (x, y, w, h)).max(initial=0) <= 0.6 + 1e-6


def test_the_papers_settings_find_the_objects_too():
    boxes = propose(*squares(LEFT, RIGHT), camera(), PAPER)
    assert min(overlaps(boxes[:10], one).max() for one in (LEFT, RIGHT)) > 0.7


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda c, z: (c[:, :, 0], z), "colour is uint8"),
        (lambda c, z: (c.astype(np.float32), z), "colour is float32"),
        (lambda c, z: (c[:100], z), "colour is uint8"),
        (lambda c, z: (c, z.astype(np.float64)), "depth is float64"),
        (lambda c, z: (c, z[:, :10]), "depth is float32"),
        (lambda c, z: (c, z * np.float32(np.nan)), "finite"),
        (lambda c, z: (c, z - np.float32(5)), "finite and not negative"),
    ],
)
def test_wrong_frames_are_refused(spoil, says):
    with pytest.raises(ValueError, match=says):
        propose(*spoil(*squares(LEFT)), camera(), ProposalSettings())
