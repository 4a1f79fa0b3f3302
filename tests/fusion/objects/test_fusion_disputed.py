"""What other views have elsewhere belongs to no object."""

import dataclasses

import numpy as np
import pytest
from fusion_room import CAMERA, standing
from numpy.typing import NDArray
from voting_room import POSES, SETTINGS, keyframe

from spot3d.boxes import iou_matrix_3d
from spot3d.camera import back_project
from spot3d.fusion.objects import disputed
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.disputed import without_disputed
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.reasons import TOO_LARGE
from spot3d.fusion.objects.views import SAMPLE, View, seen_at, view_of

BACKGROUND, ANOTHER = 0, 2
CARTON, NEIGHBOUR = standing(0, 0, (0.1, 0.1, 0.2)), standing(0.09, 0, (0.08, 0.1, 0.1), colour=(30, 60, 200))


def view_with(labels: NDArray[np.uint8], number: int) -> View:
    none = np.zeros(0, np.float32), np.zeros((0, 4)), np.zeros(0, np.int8)
    depth, colour = np.ones(CAMERA.shape, np.float32), np.zeros((*CAMERA.shape, 3), np.uint8)
    return view_of(Keyframe(number, labels, colour, depth, CAMERA, np.eye(4), *none))


@pytest.mark.parametrize(
    ("holders", "others", "their", "left"),
    [
        (9, 0, BACKGROUND, SAMPLE),
        (3, 6, BACKGROUND, SAMPLE),
        (2, 7, BACKGROUND, SAMPLE // 2),
        (0, 9, BACKGROUND, SAMPLE // 2),
        (0, 2, BACKGROUND, SAMPLE // 2),
        (0, 1, BACKGROUND, SAMPLE),
        (5, 4, ANOTHER, SAMPLE),
        (4, 5, BACKGROUND, SAMPLE),
        (4, 5, ANOTHER, SAMPLE // 2),
        (20, 40, ANOTHER, SAMPLE // 2),  # of so many views some are asked, of all of them
    ],
)
def test_a_point_is_an_objects_where_enough_of_its_views_have_it(
    holders: int, others: int, their: int, left: int
) -> None:
    """A strip of a wall: all views have its left half in label 1, some its right half as well."""
    whole = np.ones(CAMERA.shape, np.uint8)
    half = np.where(np.arange(CAMERA.width) < CAMERA.cx, whole, np.uint8(their))
    labels = [whole, *[whole] * holders, *[half] * others]
    own = np.arange(256) == 1
    views = {number: (view_with(image, number), own) for number, image in enumerate(labels)}
    places = np.zeros((1, SAMPLE, 3), np.float32)
    places[0, :, 0], places[0, :, 2] = np.linspace(-0.3, 0.3, SAMPLE), 1
    kept, enough = without_disputed(places, np.zeros(1, np.int64), views)
    assert enough.all()
    reach = places[0, left - 1, 0]
    assert abs(float(kept[0, :, 0].max()) - reach) < 0.02
    assert kept[0, :, 0].min() == places[0, 0, 0]


def test_where_all_is_disputed_all_is_kept() -> None:
    views = {k: (view_with(np.zeros(CAMERA.shape, np.uint8), k), np.zeros(256, np.bool_)) for k in range(4)}
    places = np.ones((2, SAMPLE, 3), np.float32) * np.float32((0, 0, 1))
    kept, enough = without_disputed(places, np.zeros(2, np.int64), views)
    np.testing.assert_array_equal(kept, places)
    assert enough.all()


@pytest.mark.parametrize("seed", range(3))
def test_places_are_looked_up_as_one_at_a_time(seed: int) -> None:
    """Beside the image, behind the camera, where depth is missing and at another depth as well."""
    rng, frame = np.random.default_rng(seed), keyframe(POSES[seed])
    view = view_of(dataclasses.replace(frame, depth=np.where(rng.random(CAMERA.shape) < 0.2, 0, frame.depth)))
    near = rng.integers(0, CAMERA.height, (30, SAMPLE)), rng.integers(0, CAMERA.width, (30, SAMPLE))
    at = back_project(frame.depth, CAMERA)[near] * rng.normal(1, 0.05, (30, SAMPLE, 1))
    at[::3] = rng.uniform(-3, 3, (10, SAMPLE, 3))
    places = (at @ frame.T_map_camera[:3, :3].T + frame.T_map_camera[:3, 3]).astype(np.float32)
    own, asked = rng.random(256) < 0.5, rng.random(30) < 0.8
    seen, held, lost = np.zeros((3, 30, SAMPLE), np.int32)
    disputed._tally(view.image(), own, np.ascontiguousarray(places.transpose(0, 2, 1)), asked, seen, held, lost)
    labels, depth, pose, focal = view.image()
    for i in range(30):
        pixels = [seen_at(places, i, k, depth, pose, focal, np.inf) if asked[i] else -1 for k in range(SAMPLE)]
        np.testing.assert_array_equal(seen[i], np.array(pixels) >= 0)
        label = [int(labels.ravel()[p]) if p >= 0 else -1 for p in pixels]
        np.testing.assert_array_equal(held[i], [number >= 0 and own[number] for number in label])
        np.testing.assert_array_equal(lost[i], [number > 0 and not own[number] for number in label])
    assert 0.1 < seen.mean() < 0.9


def spilling(number: int) -> Keyframe:
    """A view whose segment of the carton takes in the lower part of what stands beside it."""
    things = (CARTON, NEIGHBOUR)
    seen = keyframe(POSES[number], things, number=number)
    spilt = seen.labels.copy()
    v, u = np.nonzero(seen.labels == 2)
    spilt[v[v > np.quantile(v, 0.7)], u[v > np.quantile(v, 0.7)]] = 1
    return dataclasses.replace(seen, labels=spilt)


def test_a_box_ends_where_most_views_have_the_neighbour() -> None:
    frames = [spilling(k) if k % 6 == 0 else keyframe(POSES[k], (CARTON, NEIGHBOUR), number=k) for k in range(12)]
    found = ViewConsensus(SETTINGS).update(frames).objects
    iou = iou_matrix_3d((CARTON.box(), NEIGHBOUR.box()), [item.box for item in found])
    assert iou.shape == (2, 2)
    assert (iou.max(axis=1) > 0.8).all()
    without = ViewConsensus(SETTINGS.model_copy(update={"skipped": ("disputed",)})).update(frames).objects
    assert iou_matrix_3d((CARTON.box(),), [item.box for item in without]).max() < iou[0].max() - 0.1


def test_what_is_too_large_stays_so() -> None:
    frames = [spilling(k) if k % 6 == 0 else keyframe(POSES[k], (CARTON, NEIGHBOUR), number=k) for k in range(12)]
    agreed = ViewConsensus(SETTINGS.model_copy(update={"size_max": 0.21})).update(frames)
    assert len(agreed.objects) == 2
    narrow = ViewConsensus(SETTINGS.model_copy(update={"size_max": 0.15})).update(frames)
    assert (len(narrow.objects), narrow.left_out) == (1, {TOO_LARGE: 1})
