"""The transcriptions that stand beside the measurements agree with the kernels."""

import numpy as np
import pytest

from spot3d.bench import reference, reference_map
from spot3d.camera import Intrinsics, invert
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.index_map import IndexMap
from spot3d.fusion.map.map_arrays import FREQUENCY, HEAT, LAST, WEIGHT, R, X
from spot3d.fusion.map.merging import Pixels, merge
from spot3d.fusion.objects.agreement import Statements, clusters_of
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import ask, view_of
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.downsampling import to_lattice
from spot3d.geometry.planes import count_inliers
from spot3d.sensor import pinhole
from spot3d.source.scene.scene import Scene

CAMERA = Intrinsics(73.0, 71.0, 39.2, 30.4, 80, 60)
SETTINGS = FusionSettings()


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(seed=1, frames=6, intrinsics=CAMERA)


def test_of_no_triples_there_is_no_plane() -> None:
    points = np.ones((5, 3), np.float32)
    plane, found = reference.dominant_plane(points, 0.01, np.zeros((0, 3), np.int64))
    assert (plane.tolist(), found) == ([0, 0, 0, 0], -1)
    assert reference.triple_plane(points, np.array([0, 1, 2])) is None


@pytest.mark.parametrize("distance", [0.003, 0.05])
def test_ransac_counts_the_same_inliers(distance: float) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (700, 3)).astype(np.float32)
    points[:400, 2] = 1.5 + rng.normal(0, 0.002, 400)
    triples = rng.integers(0, len(points), (60, 3))
    planes = [plane for triple in triples if (plane := reference.triple_plane(points, triple)) is not None]
    counts = count_inliers(np.array(planes, np.float32), points, np.full(len(points), distance, np.float32))
    plain = [reference.inliers(points, plane, distance) for plane in planes]
    # A point within rounding of the limit may fall on either side.
    assert np.abs(counts - plain).max() <= 1
    best, most = reference.dominant_plane(points, distance, triples)
    assert most == max(plain) > 150
    assert abs(best[2]) > 0.99
    assert best[3] > 0


@pytest.mark.parametrize("factor", [2, 3])
def test_lattice_depth_is_the_same(scene: Scene, factor: int) -> None:
    frame = scene[0]
    depth = frame.depth_metres()
    heat = np.zeros(depth.shape, np.uint8)
    lattice = to_lattice(frame.colour, depth, heat, CAMERA, CAMERA.width // factor, grazing_cos=0)
    plain = reference.lattice_depth(depth, factor)
    assert np.count_nonzero(plain) > 0.5 * plain.size
    np.testing.assert_allclose(lattice.depth, plain, atol=1e-5)


def test_frames_are_merged_the_same_way(scene: Scene) -> None:
    rng, heatmap = np.random.default_rng(0), Heatmap3D(40_000, SETTINGS.voxel)
    plain = reference_map.copy_of(heatmap)
    assert (len(plain.rows), plain.voxels) == (0, {})
    candidates = np.full(CAMERA.shape, -1, np.int32)
    how = IndexMap(SETTINGS).how
    for number in range(1, 5):
        frame, pose = scene[number], scene.true_pose(number)
        depth, heat = frame.depth_metres(), rng.integers(0, 256, CAMERA.shape, np.uint8)
        pixels = Pixels(depth, frame.colour, heat)
        index, to_world = np.full(CAMERA.shape, -1, np.int32), pose.astype(np.float32)
        warped, found, _ = merge(heatmap.arrays, number, pixels, candidates, pinhole(CAMERA), to_world, how, index)
        plain_index, plain_warped, plain_found = reference_map.merge(
            plain, candidates, depth, frame.colour, heat, pose, CAMERA, SETTINGS.noise_gate, SETTINGS.range_max, number
        )
        assert (warped, found, heatmap.used) == (plain_warped, plain_found, len(plain.rows))
        np.testing.assert_array_equal(index, plain_index)
        _assert_same_rows(heatmap.points(), plain.rows)
        following = scene[number + 1]
        candidates = reference.warp(
            index, depth, frame.colour, following.depth_metres(), following.colour,
            invert(scene.true_pose(number + 1)) @ pose, CAMERA, SETTINGS.colour_gate, 0.03,
        )  # fmt: skip
    assert warped > 50
    assert found > 50
    assert reference_map.copy_of(heatmap).voxels == plain.voxels


def _assert_same_rows(ours: np.ndarray, plain: np.ndarray) -> None:
    for columns in (slice(X, X + 3), slice(R, R + 3), WEIGHT, HEAT, FREQUENCY):
        np.testing.assert_allclose(ours[:, columns], plain[:, columns], rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(ours.view(np.int32)[:, LAST], plain.view(np.int32)[:, LAST])


@pytest.mark.parametrize("seed", range(6))
def test_segments_are_clustered_the_same_way(seed: int) -> None:
    """Objects that frames see in part, tear apart and have in one with others."""
    rng = np.random.default_rng(seed)
    frame, thing = (part.ravel() for part in np.mgrid[:9, :4])
    seen = rng.random((len(frame), 9)) < 0.8
    seen[np.arange(len(frame)), frame] = False
    observed = np.argwhere(seen)
    whole = observed[rng.random(len(observed)) < 0.85]
    joined = np.where(rng.random(9) < 0.3, rng.integers(4, size=9), -1)  # of these frames one holds its neighbour too
    holder = np.where(thing[whole[:, 0]] == (joined[whole[:, 1]] + 1) % 4, joined[whole[:, 1]], -1)
    holder = 4 * whole[:, 1] + np.where(holder >= 0, holder, thing[whole[:, 0]])
    divided = observed[rng.random(len(observed)) < 0.1, 0]
    spilling = rng.integers(len(frame), size=6)
    background = rng.choice(spilling, size=60)
    places = rng.normal(size=(len(frame), 3)), rng.normal(size=(9, 3))
    statements = Statements(frame, observed, np.column_stack((whole[:, 0], holder)), divided, background, *places)
    found = clusters_of(statements, 3, 0.3)
    ours = {frozenset(np.flatnonzero(found == number).tolist()) for number in range(found.max() + 1)}
    assert ours == {frozenset(rows) for rows in reference.clusters(statements, 3, 0.3)}
    assert len(ours) < 20


def test_views_say_the_same(scene: Scene) -> None:
    keyframes = [labelled(scene, index) for index in range(4)]
    table, views = SegmentTable(), [view_of(keyframe) for keyframe in keyframes]
    for number, keyframe in enumerate(keyframes):
        table.extend(keyframe, number)
    table.places.rows[0] *= np.float32(0.5)  # hovers before what is seen
    names, heard = ("nothing", "through", "background", "object", "whole", "divided"), set[str]()
    for view in views:
        said, label = np.empty((2, len(table)), np.uint8)
        ask(view, table.places.rows, table.spheres.rows, said, label)
        ours = [(names[what], int(name)) for what, name in zip(said.tolist(), label, strict=True)]
        plain = reference.said_by_view(view.labels, view.depth, view.pose, view.focal, table.places.rows)
        # A point within rounding of a pixel's edge may fall on either side.
        assert sum(one != other for one, other in zip(ours, plain, strict=True)) <= 0.05 * len(table)
        heard |= {what for what, _ in plain}
    assert {"through", "background", "whole"} <= heard


def labelled(scene: Scene, index: int) -> Keyframe:
    """A keyframe with the true objects, of which each second one tells the first for background."""
    labels = scene.truth(index).instance.astype(np.uint8)
    if index % 2:
        labels[labels == np.unique(labels)[1]] = 0
    frame, none = scene[index], np.full(labels.max(), -1, np.int8)
    heat = np.ones(labels.max(), np.float32)
    pose = scene.true_pose(index)
    return Keyframe(index, labels, frame.colour, frame.depth_metres(), CAMERA, pose, heat, np.zeros((0, 4)), none)
