"""Overlap of boxes against tables, analytic shapes and sampling; the rates against counted examples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from spot3d.boxes import Box3D, corners, iou_matrix_2d, iou_matrix_3d
from spot3d.boxes import moved as in_frame
from spot3d.evaluate.scores import THRESHOLDS, _best, object_scores, recall_of

NAN = float("nan")
# Two unit squares on one centre, one turned by 45 degrees, share a regular octagon of this area.
OCTAGON = 2 * (np.sqrt(2) - 1)


def turn(axis: tuple[float, float, float], angle: float) -> NDArray[np.float64]:
    """Rotation by `angle` about `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def box(
    centre: tuple[float, ...] = (0, 0, 0),
    size: tuple[float, ...] = (1, 1, 1),
    rotation: NDArray[np.float64] | None = None,
) -> Box3D:
    return Box3D(np.array(centre), np.array(size), np.eye(3) if rotation is None else rotation)


def moved(item: Box3D, rotation: NDArray[np.float64], shift: NDArray[np.float64]) -> Box3D:
    return Box3D(rotation @ item.centre + shift, item.size, rotation @ item.rotation)


def test_a_box_in_another_frame_has_its_corners_there() -> None:
    item, T = box((1, 2, 3), (0.1, 0.2, 0.3), turn((1, 2, 3), 0.7)), np.eye(4)
    T[:3, :3], T[:3, 3] = turn((3, -1, 0), 1.1), (4, 5, 6)
    expected = corners(item) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(corners(in_frame(item, T)), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ([], [], np.zeros((0, 0))),
        ([], [[0, 0, 2, 2]], np.zeros((0, 1))),
        ([[0, 0, 2, 2]], [], np.zeros((1, 0))),
        ([[1.5, 2, 3, 4]], [[1.5, 2, 3, 4]], [[1]]),  # identical
        ([[0, 0, 2, 2]], [[5, 5, 2, 2]], [[0]]),  # disjoint
        ([[0, 0, 2, 2]], [[5, 0, 2, 2]], [[0]]),  # disjoint in x alone
        ([[0, 0, 2, 2]], [[2, 0, 2, 2]], [[0]]),  # touching
        ([[0, 0, 4, 4]], [[1, 1, 2, 2]], [[0.25]]),  # contained
        ([[0, 0, 2, 2]], [[1, 1, 2, 2]], [[1 / 7]]),  # a corner
        ([[0, 0, 2, 2]], [[0.5, 0, 2, 2]], [[0.6]]),  # between pixels
        ([[0, 0, 0, 2]], [[0, 0, 0, 2]], [[0]]),  # no area
        ([[0, 0, 2, 2, 0.9]], [[1, 0, 2, 2, 0.1]], [[1 / 3]]),  # confidences are ignored
        ([[0, 0, 2, 2], [9, 9, 1, 1]], [[0, 0, 2, 1], [9, 9, 1, 1], [4, 4, 1, 1]], [[0.5, 0, 0], [0, 1, 0]]),
    ],
)
def test_iou_2d(a: list[list[float]], b: list[list[float]], expected: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(iou_matrix_2d(a, b), expected, atol=1e-15)
    np.testing.assert_allclose(iou_matrix_2d(b, a), np.transpose(expected), atol=1e-15)


@pytest.mark.parametrize("wrong", [[[0, 0, 1]], [0, 0, 1, 1], [[0, 0, -1, 1]], [[0, NAN, 1, 1]]])
def test_iou_2d_refuses(wrong: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="2D boxes must be"):
        iou_matrix_2d(wrong, [[0, 0, 1, 1]])


rectangles = st.tuples(*[st.floats(-20, 20)] * 2, *[st.floats(0.1, 20)] * 2)


@given(rectangles, rectangles, st.floats(-50, 50))
def test_iou_2d_is_symmetric_and_invariant_to_shift_and_mirror(
    a: tuple[float, ...], b: tuple[float, ...], shift: float
) -> None:
    iou = iou_matrix_2d([a], [b])
    assert 0 <= iou[0, 0] <= 1
    np.testing.assert_array_equal(iou_matrix_2d([b], [a]), iou)
    shifted = [[(x + shift, y - shift, w, h)] for x, y, w, h in (a, b)]
    mirrored = [[(-x - w, y, w, h)] for x, y, w, h in (a, b)]
    np.testing.assert_allclose(iou_matrix_2d(*shifted), iou, atol=1e-10)
    np.testing.assert_allclose(iou_matrix_2d(*mirrored), iou, atol=1e-10)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (box(), box(), 1),  # identical
        (box(), box((3, 0, 0)), 0),  # disjoint, out of reach
        (box(), box((1.2, 1.2, 0)), 0),  # disjoint, circumscribed spheres overlap
        (box(), box((1, 0, 0)), 0),  # a face touches
        (box(), box((1, 1, 0)), 0),  # an edge touches
        (box(), box((1, 1, 1)), 0),  # a corner touches
        (box(), box(size=(0.5, 0.5, 0.5)), 1 / 8),  # contained
        (box(), box((0.25, 0.25, 0.25), (0.5, 0.5, 0.5)), 1 / 8),  # contained, three faces coincide
        (box(), box(size=(1, 1, 3)), 1 / 3),  # four faces coincide, two pierce
        (box(), box((0.5, 0, 0)), 1 / 3),  # half shared
        (box(), box((0.5, 0.5, 0.5)), 1 / 15),  # a corner shared
        (box(), box(rotation=turn((0, 0, 1), np.pi / 2)), 1),  # the same, axes renamed
        (box(), box(rotation=turn((0, 0, 1), np.pi / 4)), OCTAGON / (2 - OCTAGON)),
        (box(), box(rotation=turn((0, 1, 0), np.pi / 4)), OCTAGON / (2 - OCTAGON)),
        (
            box(),
            box(size=(1, 1, 0.5), rotation=turn((0, 0, 1), np.pi / 4)),
            OCTAGON / 2 / (1.5 - OCTAGON / 2),
        ),
        (box(size=(3, 3, 1)), box(size=(1, 1, 3), rotation=turn((0, 0, 1), 0.3)), 1 / (9 + 3 - 1)),  # a bar
        (box(size=(9, 9, 9)), box(rotation=turn((1, 2, 3), 1.1)), 1 / 729),  # contained at an angle
        (box(size=(1, 1, 0)), box(), 0),  # flat
        (box(size=(1, 1, 0)), box(size=(1, 1, 0)), 0),  # flat, identical: no volume over no volume
        (box(size=(0, 0, 0)), box(size=(0, 0, 0)), 0),  # a point
        (box(size=(1, 1, 1e-6)), box((0.5, 0, 0), (1, 1, 1e-6)), 1 / 3),  # nearly flat
    ],
)
@pytest.mark.parametrize(
    "rotation",
    [np.eye(3), turn((1, 0, 0), np.pi / 2), turn((1, -2, 0.5), 2.2)],
    ids=["axes", "quarter", "tilted"],
)
def test_iou_3d(a: Box3D, b: Box3D, expected: float, rotation: NDArray[np.float64]) -> None:
    shift = np.array([0.3, -2.0, 1.1])
    a, b = moved(a, rotation, shift), moved(b, rotation, shift)
    np.testing.assert_allclose(iou_matrix_3d([a], [b]), [[expected]], atol=1e-9)
    np.testing.assert_allclose(iou_matrix_3d([b], [a]), [[expected]], atol=1e-9)


@pytest.mark.parametrize(("a", "b"), [([], []), ([], [box()]), ([box()], [])])
def test_iou_3d_of_no_boxes(a: list[Box3D], b: list[Box3D]) -> None:
    assert iou_matrix_3d(a, b).shape == (len(a), len(b))


def test_a_corner_cut_off_by_a_tilted_face_is_a_pyramid() -> None:
    # A large box's face with the normal (1, 1, 1) cuts off a corner of the unit cube, 0.6 of three edges.
    normal = np.full(3, 1 / np.sqrt(3))
    rotation = turn((0, -1, 1), np.arccos(normal[0]))
    np.testing.assert_allclose(rotation[:, 0], normal, atol=1e-12)
    inner_face = 0.9 / np.sqrt(3)  # the plane x + y + z = 0.9, so each edge of the corner loses 0.6
    large = Box3D(normal * (inner_face + 5), np.full(3, 10.0), rotation)
    shared = 0.6**3 / 6
    np.testing.assert_allclose(iou_matrix_3d([box()], [large]), shared / (1001 - shared), rtol=1e-9)


def random_box(rng: np.random.Generator) -> Box3D:
    rotation = turn(tuple(rng.normal(size=3)), rng.uniform(0, np.pi))
    return Box3D(rng.uniform(-0.3, 0.3, 3), rng.uniform(0.2, 1.0, 3), rotation)


def test_iou_3d_of_random_boxes_agrees_with_sampling() -> None:
    rng = np.random.default_rng(7)
    boxes_a = [random_box(rng) for _ in range(6)]
    boxes_b = [random_box(rng) for _ in range(5)]
    samples = 20_000
    sampled = np.zeros((6, 5))
    for i, a in enumerate(boxes_a):
        points = a.centre + (rng.uniform(-0.5, 0.5, (samples, 3)) * a.size) @ a.rotation.T
        for j, b in enumerate(boxes_b):
            inside = (np.abs((points - b.centre) @ b.rotation) <= b.size / 2).all(axis=1)
            shared = inside.mean() * a.volume
            sampled[i, j] = shared / (a.volume + b.volume - shared)
    assert (sampled > 0.05).sum() > 10
    # The sampled share is off by at most 0.5 / sqrt(20000) = 0.0035 (one sigma), the IoU by less.
    np.testing.assert_allclose(iou_matrix_3d(boxes_a, boxes_b), sampled, atol=0.015)


@pytest.mark.parametrize("at_once", [4096, 10])
def test_iou_3d_of_many_pairs_is_that_of_each_pair(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr("spot3d.boxes._AT_ONCE", at_once)
    rng = np.random.default_rng(3)
    boxes = [random_box(rng) for _ in range(7)]
    single = [[iou_matrix_3d([a], [b])[0, 0] for b in boxes] for a in boxes]
    np.testing.assert_allclose(iou_matrix_3d(boxes, boxes), single, atol=1e-14)
    np.testing.assert_allclose(np.diag(single), 1, atol=1e-12)


unit = st.floats(-1, 1)
vectors = st.tuples(unit, unit, unit)
sizes = st.tuples(*[st.floats(0.05, 1.5)] * 3)
axes = vectors.filter(lambda axis: np.linalg.norm(axis) > 0.1)
angles = st.floats(0, np.pi)
any_box = st.builds(lambda c, s, axis, angle: box(c, s, turn(axis, angle)), vectors, sizes, axes, angles)


@given(any_box, any_box, axes, angles, vectors)
def test_iou_3d_is_symmetric_and_invariant_to_rigid_motion(
    a: Box3D, b: Box3D, axis: tuple[float, float, float], angle: float, shift: tuple[float, ...]
) -> None:
    iou = iou_matrix_3d([a], [b])
    assert 0 <= iou[0, 0] <= 1
    np.testing.assert_allclose(iou_matrix_3d([b], [a]), iou, atol=1e-9)
    rotation = turn(axis, angle)
    after = iou_matrix_3d([moved(a, rotation, np.array(shift))], [moved(b, rotation, np.array(shift))])
    np.testing.assert_allclose(after, iou, atol=1e-9)


@given(vectors, sizes, vectors, sizes, axes, angles)
def test_boxes_with_parallel_axes_overlap_as_intervals_do(
    centre_a: tuple[float, ...],
    size_a: tuple[float, ...],
    centre_b: tuple[float, ...],
    size_b: tuple[float, ...],
    axis: tuple[float, float, float],
    angle: float,
) -> None:
    a, b = box(centre_a, size_a), box(centre_b, size_b)
    high = np.minimum(a.centre + a.size / 2, b.centre + b.size / 2)
    low = np.maximum(a.centre - a.size / 2, b.centre - b.size / 2)
    shared = float(np.prod(np.maximum(high - low, 0)))
    rotation = turn(axis, angle)
    iou = iou_matrix_3d([moved(a, rotation, np.zeros(3))], [moved(b, rotation, np.zeros(3))])
    np.testing.assert_allclose(iou, shared / (a.volume + b.volume - shared), atol=1e-9)


@pytest.mark.parametrize(
    ("centre", "size", "rotation", "message"),
    [
        ((0, 0), (1, 1, 1), np.eye(3), "centre"),
        ((0, 0, NAN), (1, 1, 1), np.eye(3), "centre"),
        ((0, 0, 0), (1, -1, 1), np.eye(3), "size must not be negative"),
        ((0, 0, 0), (1, 1, 1), np.eye(4), "rotation"),
        ((0, 0, 0), (1, 1, 1), 2 * np.eye(3), "rotation matrix"),
        ((0, 0, 0), (1, 1, 1), np.diag([1, 1, -1]), "right-handed"),
    ],
)
def test_box_refuses(
    centre: tuple[float, ...], size: tuple[float, ...], rotation: NDArray[np.float64], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        box(centre, size, rotation)


EMPTY = np.zeros((0, 0))
# Two objects, three proposals: the first object is found twice, the second hardly, one proposal is redundant.
TWICE = np.array([[0.8, 0.5, 0.0], [0.0, 0.0, 0.3]])
MISSED = np.zeros((2, 0))
FALSE_ALARM = np.zeros((0, 1))


@pytest.mark.parametrize(
    ("scenes", "detection", "success", "iou", "modified"),
    [
        ([], NAN, NAN, NAN, NAN),
        ([EMPTY], NAN, NAN, NAN, NAN),
        ([MISSED], 0, NAN, 0, NAN),
        ([FALSE_ALARM], NAN, 0, NAN, 0),
        ([np.ones((1, 1))], 1, 1, 1, 1),
        ([TWICE], 1 / 2, 2 / 3, 1.1 / 2, 1.6 / 3),
        ([TWICE, MISSED], 1 / 4, 2 / 3, 1.1 / 4, 1.6 / 3),  # objects are pooled, not scenes averaged
        ([TWICE, FALSE_ALARM, EMPTY], 1 / 2, 2 / 4, 1.1 / 2, 1.6 / 4),
        ([TWICE, np.ones((1, 1))], 2 / 3, 3 / 4, 2.1 / 3, 2.6 / 4),
    ],
)
def test_rates(
    scenes: list[NDArray[np.float64]], detection: float, success: float, iou: float, modified: float
) -> None:
    np.testing.assert_allclose(object_scores(scenes), (iou, modified, success, detection), atol=1e-12)


def test_iou_of_each_object_and_each_proposal() -> None:
    np.testing.assert_array_equal(_best([TWICE], 1), [0.8, 0.3])
    np.testing.assert_array_equal(_best([TWICE], 0), [0.8, 0.5, 0.3])
    np.testing.assert_array_equal(_best([MISSED], 1), [0, 0])
    np.testing.assert_array_equal(_best([FALSE_ALARM], 0), [0])


def test_recall_curve() -> None:
    below_and_above = np.isin(THRESHOLDS.round(3), [0.0, 0.275, 0.325, 0.775, 0.825])
    both = [TWICE, np.ones((1, 1))]
    np.testing.assert_allclose(recall_of("", "", [TWICE]).recall[below_and_above], [1, 1, 0.5, 0.5, 0])
    np.testing.assert_allclose(recall_of("", "", both).recall[below_and_above], [1, 1, 2 / 3, 2 / 3, 1 / 3])
    assert recall_of("", "", both).recall[-1] == 1 / 3
    assert np.isnan(recall_of("", "", []).recall).all()
