"""Dominant planes through triples of points, none of them fitted."""

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE_PAPER, ROOM, look_at, view

from spot3d.camera import back_project, invert
from spot3d.fusion.paper.ransac import planes_by_ransac
from spot3d.fusion.settings import PAPER
from spot3d.geometry.planes import transform_plane

POSE = look_at((0.9, -1.3, 0.8), (0.3, 0.5, -0.15))  # sees table, floor and wall
TRUTH = [
    transform_plane(np.array(plane), invert(POSE)) for plane in ([0, 0, 1.0, 0], [0, 0, 1.0, 0.75], [0, -1, 0, 1.5])
]


def room_points(noise: np.random.Generator | None = None) -> np.ndarray:
    return back_project(view(POSE, ROOM, noise).depth, CAMERA)


def counted(points: np.ndarray, plane: np.ndarray) -> int:
    flat = points.reshape(-1, 3)[points.reshape(-1, 3)[:, 2] > 0]
    return int((np.abs(flat @ plane[:3] + plane[3]) < PAPER.plane_distance).sum())


@pytest.mark.parametrize("seed", range(3))
def test_five_distinct_planes_come_most_inliers_first_and_the_rooms_are_among_them(seed: int) -> None:
    points = room_points(np.random.default_rng(seed))
    planes = planes_by_ransac(points, PAPER, np.random.default_rng(seed))
    assert planes.shape == (5, 4)
    assert (planes[:, 3] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1, atol=1e-9)
    counts = [counted(points, plane) for plane in planes]
    assert counts == sorted(counts, reverse=True)
    for truth in TRUTH:
        assert any(plane[:3] @ truth[:3] > 0.98 and abs(plane[3] - truth[3]) < 0.06 for plane in planes)


def test_a_plane_goes_through_three_points_and_is_not_fitted() -> None:
    points = room_points(np.random.default_rng(1))
    flat = points[points[..., 2] > 0].astype(np.float64)
    for plane in planes_by_ransac(points, PAPER, np.random.default_rng(1)):
        assert np.sort(np.abs(flat @ plane[:3] + plane[3]))[2] < 1e-7


def test_fewer_triples_find_worse_planes() -> None:
    points = room_points(np.random.default_rng(2))
    most = [
        counted(
            points, planes_by_ransac(points, PAPER.model_copy(update={"plane_triples": n}), np.random.default_rng(0))[0]
        )
        for n in (10, 10_000)
    ]
    assert most[0] < most[1]


@pytest.mark.parametrize(
    ("name", "depth"),
    [
        ("nothing", np.zeros(CAMERA.shape)),
        ("not a number", np.full(CAMERA.shape, np.nan)),
        ("a single line", np.pad(np.ones((1, 160)), ((50, 69), (0, 0)))),
    ],
)
def test_where_there_is_no_plane(name: str, depth: np.ndarray) -> None:
    points = back_project(depth.astype(np.float32), CAMERA)
    assert planes_by_ransac(points, COARSE_PAPER, np.random.default_rng(0)).shape == (0, 4), name
