"""What a view says of a segment of another one."""

import numpy as np
import pytest
from numpy.typing import NDArray
from voting_room import POSES, keyframe

from spot3d.camera import Intrinsics
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.segment_table import spheres_around
from spot3d.fusion.objects.views import (
    BACKGROUND,
    DIVIDED,
    NOTHING,
    OBJECT,
    SAMPLE,
    STRIDE,
    THROUGH,
    WHOLE,
    View,
    ask,
    view_of,
)

CAMERA = Intrinsics(100.0, 100.0, 49.5, 39.5, 100, 80)


def wall(
    labels: NDArray[np.uint8],
    distance: float = 1.0,
    pose: NDArray[np.float64] | None = None,
    range_max: float = np.inf,
) -> View:
    """A view of a wall in front of the camera."""
    depth, colour = np.full(CAMERA.shape, distance, np.float32), np.zeros((*CAMERA.shape, 3), np.uint8)
    T = np.eye(4) if pose is None else pose
    none = np.zeros(0, np.float32), np.zeros((0, 4)), np.zeros(0, np.int8)
    return view_of(Keyframe(0, labels, colour, depth, CAMERA, T, *none), range_max)


def strip(low: float = -0.2, high: float = 0.2, z: float = 1.0, y: float = 0.0) -> NDArray[np.float32]:
    """A segment: places along x."""
    places = np.zeros((1, SAMPLE, 3), np.float32)
    places[0, :, 0], places[0, :, 1], places[0, :, 2] = np.linspace(low, high, SAMPLE), y, z
    return places


def said_of(view: View, places: NDArray[np.float32]) -> tuple[int, int]:
    said, label = np.full(1, 99, np.uint8), np.full(1, 99, np.uint8)
    ask(view, places, spheres_around(places), said, label)
    return int(said[0]), int(label[0])


def striped(*shares: tuple[int, float]) -> NDArray[np.uint8]:
    """Labels of columns from x = -0.2 m to 0.2 m of the wall, each for a share of that."""
    labels, start = np.zeros(CAMERA.shape, np.uint8), 29.5
    for label, share in shares:
        labels[:, round(start) : round(start + 40 * share)] = label
        start += 40 * share
    return labels


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        (((7, 1.0),), (WHOLE, 7)),
        (((7, 0.8), (0, 0.2)), (WHOLE, 7)),
        (((7, 0.9), (3, 0.1)), (WHOLE, 7)),
        (((7, 0.75), (3, 0.25)), (DIVIDED, 0)),
        (((7, 0.6), (0, 0.4)), (OBJECT, 0)),
        (((7, 0.6), (3, 0.4)), (DIVIDED, 0)),
        (((7, 0.4), (3, 0.3), (0, 0.3)), (DIVIDED, 0)),
        (((7, 0.4), (0, 0.6)), (BACKGROUND, 0)),
        (((255, 1.0),), (WHOLE, 255)),
        ((), (BACKGROUND, 0)),
    ],
)
def test_labels_decide(shares: tuple[tuple[int, float], ...], expected: tuple[int, int]) -> None:
    assert said_of(wall(striped(*shares)), strip()) == expected


@pytest.mark.parametrize(
    ("places", "expected"),
    [
        (strip(), WHOLE),
        (strip(z=1.02), WHOLE),
        (strip(z=0.98), WHOLE),
        (strip(z=0.95), THROUGH),  # hovers in front of what is seen
        (strip(z=0.2), THROUGH),
        (strip(z=1.2), NOTHING),  # hidden
        (strip(z=-1.0), NOTHING),  # behind the camera
        (strip(z=0.0), NOTHING),
        (strip(y=3.0), NOTHING),
        (strip(low=0.35, high=0.7), WHOLE),  # 0.14 of its 0.35 m are in the image
        (strip(low=0.45, high=0.8), NOTHING),  # 0.04
        (strip(low=0.25, high=0.7, z=0.9), NOTHING),  # less than half of it would be
        (strip(low=300.0, high=300.1), NOTHING),
    ],
)
def test_what_is_seen(places: NDArray[np.float32], expected: int) -> None:
    view = wall(np.full(CAMERA.shape, 1, np.uint8))
    assert said_of(view, places) == (expected, int(expected == WHOLE))


def test_what_is_seen_in_part_is_not_looked_through() -> None:
    places = strip()
    places[0, : SAMPLE // 2, 2] = 0.9
    assert said_of(wall(np.full(CAMERA.shape, 1, np.uint8)), places) == (WHOLE, 1)


@pytest.mark.parametrize(
    ("distance", "range_max", "z", "expected"),
    [(3.0, 2.5, 2.4, THROUGH), (3.0, 2.5, 2.6, NOTHING), (70.0, np.inf, 60.0, THROUGH), (70.0, np.inf, 69.0, NOTHING)],
)
def test_what_is_too_far_to_look_for_objects_hides_nothing_before_it(
    distance: float, range_max: float, z: float, expected: int
) -> None:
    """What is beyond 16 bits of millimetres is as well."""
    view = wall(np.zeros(CAMERA.shape, np.uint8), distance, range_max=range_max)
    assert said_of(view, strip(z=z)) == (expected, 0)


@pytest.mark.parametrize(
    ("labelled", "range_max", "expected"),
    [(0.0, 2.9, NOTHING), (0.0, 3.0, BACKGROUND), (0.0, np.inf, BACKGROUND), (1.0, 2.9, WHOLE), (0.4, 2.9, WHOLE)],
)
def test_where_nobody_looked_what_has_no_label_is_not_seen(labelled: float, range_max: float, expected: int) -> None:
    assert said_of(wall(striped((7, labelled)), 3.0, range_max=range_max), 3 * strip())[0] == expected


def test_holes_and_an_empty_image_see_nothing() -> None:
    labels = np.full(CAMERA.shape, 1, np.uint8)
    assert said_of(wall(labels, distance=0.0), strip()) == (NOTHING, 0)
    assert said_of(wall(labels, distance=70.0), strip(z=70.0)) == (NOTHING, 0), "beyond 16 bits of millimetres"
    assert said_of(wall(labels, distance=70.0), strip(z=70.0 - 65.536))[0] == THROUGH


@pytest.mark.parametrize(("distance", "seen"), [(0.08, False), (0.12, True)])
def test_what_is_too_near_is_not_seen(distance: float, seen: bool) -> None:
    said, _ = said_of(wall(np.full(CAMERA.shape, 1, np.uint8), distance), strip(-0.01, 0.01, distance))
    assert (said == WHOLE) == seen


def test_a_view_keeps_every_second_pixel() -> None:
    frame = keyframe(POSES[0])
    view = view_of(frame)
    np.testing.assert_array_equal(view.labels, frame.labels[::STRIDE, ::STRIDE])
    np.testing.assert_allclose(view.depth / 1000, frame.depth[::STRIDE, ::STRIDE], atol=6e-4)


def test_what_is_out_of_reach_would_not_have_been_seen() -> None:
    """The sphere around a segment spares asking, and changes no answer."""
    rng = np.random.default_rng(0)
    view = view_of(keyframe(POSES[0]))
    places = (rng.uniform((-1, -1, -0.1), (1, 1, 0.2), (2000, 1, 3)) + rng.normal(0, 0.01, (2000, SAMPLE, 3))).astype(
        np.float32
    )
    answers = []
    for spheres in (
        spheres_around(places),
        np.tile(np.float32((0, 0, 0, 1e6)), (2000, 1)),
    ):
        said, label = np.empty(2000, np.uint8), np.empty(2000, np.uint8)
        ask(view, places, spheres, said, label)
        answers.append((said.tolist(), label.tolist()))
    assert answers[0] == answers[1]
    assert 20 < np.count_nonzero(answers[0][0]) < 1000


def test_a_segment_is_seen_where_it_is_from() -> None:
    frame = keyframe(POSES[3])
    view = view_of(frame)
    v, u = np.nonzero(frame.labels == 2)
    z, k = frame.depth[v, u], frame.camera
    points = np.column_stack(((u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z)) @ POSES[3][:3, :3].T + POSES[3][:3, 3]
    chosen = points[np.linspace(0, len(points) - 1, SAMPLE).astype(int)].astype(np.float32)
    assert said_of(view, chosen[None]) == (WHOLE, 2)
