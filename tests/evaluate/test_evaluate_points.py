"""Points inside boxes, and the paper's point-wise precision, recall and F, against counted examples."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.evaluate.points import PointScores, mean_point_scores, point_scores, points_in_boxes

NAN = float("nan")
HALF = np.sqrt(0.5)
YAW_45 = np.array([[HALF, -HALF, 0], [HALF, HALF, 0], [0, 0, 1]])


def cube(x: float, size: float = 1.0, rotation: NDArray[np.float64] | None = None) -> Box3D:
    return Box3D(np.array([x, 0, 0]), np.full(3, size), np.eye(3) if rotation is None else rotation)


@pytest.mark.parametrize(
    ("points", "boxes", "expected"),
    [
        ([], [], []),
        ([], [cube(0)], []),
        ([[0, 0, 0]], [], [False]),
        ([[0, 0, 0], [2, 0, 0]], [cube(0)], [True, False]),
        (
            [[0.5, 0.5, 0.5], [0.50001, 0, 0], [0, -0.50001, 0], [-0.5, 0, 0]],
            [cube(0)],
            [True, False, False, True],
        ),
        ([[2, 0, 0], [9, 0, 0], [0, 0, 0]], [cube(0), cube(2)], [True, False, True]),
        ([[0.6, 0, 0], [0.45, 0.45, 0]], [cube(0, rotation=YAW_45)], [True, False]),
        ([[NAN, 0, 0], [0, 0, NAN], [0, 0, 0]], [cube(0)], [False, False, True]),
        ([[0, 0, 0], [0, 0, 1e-3]], [Box3D(np.zeros(3), np.array([1.0, 1, 0]), np.eye(3))], [True, False]),
    ],
)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_points_in_boxes(
    points: list[list[float]], boxes: list[Box3D], expected: list[bool], dtype: type[np.floating]
) -> None:
    found = points_in_boxes(np.array(points, dtype=dtype).reshape(-1, 3), boxes)
    assert found.dtype == np.bool_
    assert found.tolist() == expected


def test_points_in_random_boxes_are_those_of_a_plain_search() -> None:
    rng = np.random.default_rng(11)
    xyz = rng.uniform(-1, 1, (5000, 3)).astype(np.float32)
    boxes = []
    for _ in range(8):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        boxes.append(Box3D(rng.uniform(-1, 1, 3), rng.uniform(0.1, 0.8, 3), rotation))
    plain = np.zeros(len(xyz), dtype=bool)
    for box in boxes:
        plain |= (np.abs((xyz.astype(np.float64) - box.centre) @ box.rotation) <= box.size / 2).all(axis=1)
    assert 100 < plain.sum() < 4900
    np.testing.assert_array_equal(points_in_boxes(xyz, boxes), plain)


def test_points_of_a_wrong_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        points_in_boxes(np.zeros((4, 2)), [])
    with pytest.raises(ValueError, match="one label per point"):
        point_scores(np.zeros((4, 3)), np.zeros(3, dtype=np.uint8), [])


# Along x: two points of object 1 at 0, two of object 2 at 2, background at 0 and 4, furniture at 0 and 6.
X = np.array([0.0, 0.1, 2.0, 2.1, 0.2, 4.0, 0.3, 6.0])
LABEL = np.array([1, 1, 2, 2, 0, 0, 255, 255], dtype=np.uint8)


@pytest.mark.parametrize(
    ("boxes", "expected"),
    [
        ([], (NAN, 0, 0)),  # nothing proposed
        ([cube(9)], (NAN, 0, 0)),  # nothing inside
        ([cube(6)], (NAN, 0, 0)),  # furniture alone: neither right nor wrong
        ([cube(4)], (0, 0, 0)),  # background alone
        ([cube(2)], (100, 50, 200 / 3)),
        ([cube(0)], (200 / 3, 50, 400 / 7)),  # two true, one false, two missed
        ([cube(0), cube(0), cube(0, 0.9)], (200 / 3, 50, 400 / 7)),  # a point counts once
        ([cube(0), cube(2)], (80, 100, 800 / 9)),
        ([cube(0, 100)], (200 / 3, 100, 80)),  # one box around everything
    ],
)
def test_point_scores(boxes: list[Box3D], expected: tuple[float, float, float]) -> None:
    xyz = np.stack((X, np.zeros_like(X), np.zeros_like(X)), axis=1)
    scores = point_scores(xyz, LABEL, boxes)
    np.testing.assert_allclose((scores.precision, scores.recall, scores.f_measure), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("labels", "expected"), [([], (NAN, NAN, NAN)), ([255, 255], (NAN, NAN, NAN)), ([0, 255], (0, NAN, 0))]
)
def test_point_scores_without_points_of_interest(labels: list[int], expected: tuple[float, ...]) -> None:
    scores = point_scores(np.zeros((len(labels), 3)), np.array(labels, dtype=np.uint8), [cube(0)])
    np.testing.assert_allclose((scores.precision, scores.recall, scores.f_measure), expected)


@pytest.mark.parametrize(
    ("scenes", "expected"),
    [
        ([], (NAN, NAN, NAN)),
        ([PointScores(0, 0, 0)], (0, 0, 0)),
        ([PointScores(93.46, 76.24, 0)], (93.46, 76.24, 83.977)),  # the paper's own AP, AR and F
        ([PointScores(100, 50, 200 / 3), PointScores(50, 100, 200 / 3)], (75, 75, 75)),
        ([PointScores(100, 50, 200 / 3), PointScores(NAN, 0, 0)], (100, 25, 40)),
    ],
)
def test_mean_point_scores(scenes: list[PointScores], expected: tuple[float, float, float]) -> None:
    mean = mean_point_scores(scenes)
    np.testing.assert_allclose((mean.precision, mean.recall, mean.f_measure), expected, atol=1e-3)


def test_points_on_a_surface_are_in_the_box_however_they_are_rounded() -> None:
    rng = np.random.default_rng(0)
    box = Box3D(np.array((0.31, -1.7, 0.9)), np.array((0.13, 0.07, 0.211)), np.linalg.qr(rng.normal(size=(3, 3)))[0])
    local = rng.uniform(-0.5, 0.5, (3000, 3))
    local[np.arange(3000), np.arange(3000) % 3] = np.sign(local[:, 0]) / 2
    points = (box.centre + (local * box.size) @ box.rotation.T).astype(np.float32)
    assert points_in_boxes(points, [box]).all()
