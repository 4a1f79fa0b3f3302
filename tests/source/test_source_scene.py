"""The built-in scene: the same for a seed, true about itself, and as noisy as a Kinect."""

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest

from spot3d.camera import Intrinsics, back_project
from spot3d.source.errors import SourceError
from spot3d.source.scene.bin import things_about_bin
from spot3d.source.scene.desk import DESK_REGION, things_on_desk
from spot3d.source.scene.levels import things_in_room
from spot3d.source.scene.model import TrueBox, build_scene, first_frames
from spot3d.source.scene.name import SceneKind
from spot3d.source.scene.noise import block_noise, measured_depth, noisy_colour
from spot3d.source.scene.path import camera_pose
from spot3d.source.scene.placement import TABLE_HEIGHT, Placed, footprint, separation
from spot3d.source.scene.scene import Scene
from spot3d.source.scene.shelf import BOARDS, things_on_shelf
from spot3d.source.scene.table import things_on_table
from spot3d.source.sequences import open_source

SMALL = Intrinsics(585 / 4, 585 / 4, 80.0, 60.0, 160, 120)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(seed=1, intrinsics=SMALL)


def test_frames_depend_on_seed_and_index_alone(scene: Scene) -> None:
    again = Scene(seed=1, frames=1000, intrinsics=SMALL)
    last, first = scene[7], scene[3]
    for frame, other in ((first, again[3]), (last, again[7])):
        np.testing.assert_array_equal(frame.depth, other.depth)
        np.testing.assert_array_equal(frame.colour, other.colour)
        np.testing.assert_array_equal(frame.T_world_camera, other.T_world_camera)
    assert not np.array_equal(Scene(seed=2, intrinsics=SMALL)[3].depth, first.depth)


def test_sequence(scene: Scene) -> None:
    assert len(scene) == len(scene.stamps_ns) == 300
    assert scene[-1].stamp_ns == scene.stamps_ns[-1] == 299 * 10**9 // 30
    assert scene.has_true_poses
    assert scene.up.tolist() == [0, 0, 1]
    with pytest.raises(IndexError):
        scene[300]


@pytest.mark.parametrize("cluttered", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_arrangement_on_table(seed: int, cluttered: bool) -> None:
    placed = things_on_table(seed, cluttered)
    if cluttered:
        assert 18 <= len(placed) <= 24
    else:
        assert len(placed) == 12
    gaps = [separation(footprint(a), footprint(b)) for a, b in combinations(placed, 2) if a.z == b.z]
    assert sum(gap < 0.003 for gap in gaps) >= 1 + cluttered, "some touch"
    heights = {round(p.z, 3) for p in placed}
    assert len(heights) > 2, "one is stacked"
    assert sum(p.z == 0.98 for p in placed) >= 2, "two are on the shelf"
    assert_apart(placed)
    sizes = np.array([p.thing.size for p in placed])
    assert sizes.max() < 0.35
    assert sizes.max(axis=1).min() > 0.04


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_arrangement_on_desk(seed: int) -> None:
    placed = things_on_desk(seed)
    assert len(placed) == 14
    names = [p.thing.name for p in placed]
    assert names[:5] == ["monitor", "keyboard", "mouse", "laptop", "lamp"]
    assert len(set(names)) == 14, "no thing is there twice"
    assert sum(p.z > 0.75 for p in placed) == 1, "one is stacked"
    assert_apart(placed)
    low, high = (np.array([f(footprint(p), axis=0) for p in placed]) for f in (np.min, np.max))
    assert (low >= DESK_REGION[::2]).all()
    assert (high <= DESK_REGION[1::2]).all()
    sizes = np.array([p.thing.size for p in placed])
    assert sizes.max() < 0.60
    assert sizes.max(axis=1).min() > 0.04


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
@pytest.mark.parametrize(
    ("arranged", "count", "crate", "heights", "inside"),
    [(things_on_shelf, 11, "crate", BOARDS, 2), (things_about_bin, 10, "bin", (TABLE_HEIGHT,), 6)],
)
def test_arrangement_in_a_crate(
    arranged: Callable[[int], list[Placed]],
    count: int,
    crate: str,
    heights: tuple[float, ...],
    inside: int,
    seed: int,
) -> None:
    placed = arranged(seed)
    assert len(placed) == count
    put_in = [p for p in placed if p.z not in heights]
    assert len(put_in) == inside
    assert_put_in(put_in, next(p for p in placed if p.thing.name == crate))
    assert_apart([p for p in placed if p not in put_in])


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_arrangement_in_room(seed: int) -> None:
    placed = things_in_room(seed)
    assert len(placed) == 19
    levels = {p.z for p in placed}
    assert len(levels) == 4, "the floor, the chest, the stool and the table"
    assert {0.0, TABLE_HEIGHT} < levels
    assert_apart(placed)


def assert_put_in(things: list[Placed], crate: Placed) -> None:
    """The things stand on the bottom of a crate, between its walls and beside each other."""
    for p in things:
        c, s = np.cos(crate.yaw), np.sin(crate.yaw)
        local = (footprint(p) - (crate.x, crate.y)) @ np.array([[c, -s], [s, c]])
        assert (np.abs(local) < np.array(crate.thing.size[:2]) / 2 - 0.009).all(), "between its walls"
        assert crate.z < p.z < crate.z + 0.02, "on its bottom"
    assert_apart(things)


def assert_apart(placed: list[Placed]) -> None:
    """No two things have a point in common."""
    for low, high in combinations(sorted(placed, key=lambda p: p.z), 2):
        beside = separation(footprint(low), footprint(high)) >= 0
        above = high.z >= low.z + low.thing.size[2] - 1e-9
        assert beside or above, f"{low.thing.name} and {high.thing.name} interpenetrate"


def inside_share(points: np.ndarray, box: TrueBox, tolerance: float) -> float:
    local = (points - box.centre) @ box.rotation
    return float((np.abs(local) <= box.size / 2 + tolerance).all(axis=1).mean())


@pytest.mark.parametrize("kind", ["table", "desk", "shelf", "bin", "room", "changing"])
def test_true_boxes_hold_their_points_tightly(kind: SceneKind) -> None:
    longer = Scene(1, kind, frames=600, intrinsics=SMALL)
    points: dict[int, list[np.ndarray]] = {box.id: [] for box in longer.boxes}
    for index in range(longer.settled_from, 600, 50):
        view = longer.truth(index)
        pose = longer.true_pose(index)
        world = back_project(view.depth, SMALL) @ pose[:3, :3].T + pose[:3, 3]
        for box in longer.boxes:
            points[box.id].append(world[view.instance == box.id])
    for box in longer.boxes:
        cloud = np.concatenate(points[box.id])
        assert len(cloud) > 100, f"{box.name} is hardly seen"
        assert inside_share(cloud, box, 1e-4) == 1.0, box.name
        local = (cloud - box.centre) @ box.rotation
        extent = local.max(axis=0) - local.min(axis=0)
        # From an arc on one side, at a coarse resolution; the box must not be much larger than what is seen.
        assert (extent > 0.5 * box.size).all(), (box.name, extent, box.size)


@pytest.mark.parametrize("kind", ["table", "cluttered", "desk", "near", "shelf", "bin", "room", "changing"])
def test_every_object_is_seen(kind: SceneKind) -> None:
    scene = Scene(3, kind, intrinsics=SMALL)
    best = np.zeros(max(box.id for box in scene.boxes) + 1)
    for index in range(0, 300, 25):
        best = np.maximum(best, np.bincount(scene.truth(index).instance.ravel(), minlength=len(best)))
    assert best[1:].min() > 15, "in quarter-size pixels"


@pytest.mark.parametrize("kind", ["table", "desk", "shelf", "bin", "room", "changing"])
def test_instances_are_the_boxes(kind: SceneKind) -> None:
    for first in first_frames(kind):
        model = build_scene(0, kind, first)
        assert set(model.solids.instance.tolist()) == {0, *(box.id for box in model.boxes)}
        for box in model.boxes:
            np.testing.assert_allclose(box.rotation @ box.rotation.T, np.eye(3), atol=1e-12)
            np.testing.assert_array_equal(box.rotation[2], [0, 0, 1])


@pytest.mark.parametrize(
    ("kind", "least", "mean", "most", "fastest"),
    [
        ("table", 4, 10, 15, 1),
        ("desk", 10, 17, 25, 1),
        ("near", 10, 17, 25, 2.5),
        ("shelf", 4, 10, 20, 1.2),
        ("bin", 3, 7, 15, 1.5),
        ("room", 4, 11, 20, 1.2),
    ],
)
def test_camera_moves_as_a_hand_does(kind: SceneKind, least: float, mean: float, most: float, fastest: float) -> None:
    """Bounds of the mean and of each step in millimetres, and of how fast it turns, over that of a slow hand."""
    poses = np.array([camera_pose(index, 0, kind) for index in range(1200)])
    steps = 1000 * np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    turns = np.einsum("nij,nij->n", poses[1:, :3, :3], poses[:-1, :3, :3])
    degrees = np.degrees(np.arccos(np.clip((turns - 1) / 2, -1, 1)))
    assert least < steps.mean() < mean
    assert steps.max() < most
    assert 0.25 < degrees.mean() / fastest < 0.6
    assert degrees.max() < 1.2 * fastest


def test_camera_walks_around_the_desk() -> None:
    eyes = np.array([camera_pose(index, 1, "desk")[:2, 3] for index in range(0, 1800, 3)])
    distance = np.linalg.norm(eyes, axis=1)
    assert 1.4 < distance.min() < 1.6
    assert 2.2 < distance.max() < 2.4
    turned = np.unwrap(np.arctan2(eyes[:, 1], eyes[:, 0]))
    assert turned[-1] - turned[0] == pytest.approx(4 * np.pi, abs=0.1)


def test_camera_is_swept_near_the_desk() -> None:
    poses = np.array([camera_pose(index, 1, "near") for index in range(1200)])
    ahead = (poses[:, 2, 3] - TABLE_HEIGHT) / -poses[:, 2, 2]
    assert 0.6 < ahead.min() < 0.9
    assert 1.2 < ahead.max() < 1.5
    assert np.ptp(poses[:, :2, 3], axis=0) == pytest.approx([0.37, 1.5], abs=0.03)


@pytest.mark.parametrize("metres", [1.0, 2.0])
def test_noise_follows_the_kinects(metres: float) -> None:
    exact = np.full((480, 640), metres, np.float32)
    # A slope of some quantisation steps, so that rounding errors are spread evenly.
    exact += (np.linspace(-0.05, 0.05, 640) * metres).astype(np.float32)
    measured = measured_depth(exact, np.ones_like(exact), 585.0, 0, 4) / 1000.0
    error = (measured - exact)[:, :600]
    assert (measured[:, :600] > 0).all()
    sigma = 0.0012 + 0.0019 * (metres - 0.4) ** 2
    assert error.std() == pytest.approx(sigma, rel=0.1)
    assert abs(error.mean()) < 0.1 * sigma
    correlation = [(error[:, k:] * error[:, :-k]).mean() / error.var() for k in (1, 3, 10)]
    assert 0.5 < correlation[0] < 0.85
    assert 0.2 < correlation[1] < 0.6
    assert abs(correlation[2]) < 0.1


def test_depth_comes_in_the_kinects_steps() -> None:
    exact = np.linspace(1.9, 2.1, 480 * 640, dtype=np.float32).reshape(480, 640)
    values = np.unique(measured_depth(exact, np.ones_like(exact), 585.0, 0, 0))
    steps = np.diff(values[values > 0])
    # 2.85 mm/m2 * z^2, rounded to whole millimetres.
    assert steps.min() >= 9
    assert steps.max() <= 14


def test_missing_depth() -> None:
    exact = np.full((480, 640), 2.0, np.float32)
    exact[:, 300:400] = 1.0
    exact[:60] = 0.4
    exact[420:] = 6.0
    cosine = np.ones_like(exact)
    cosine[200:260] = 0.05
    depth = measured_depth(exact, cosine, 585.0, 0, 0)
    assert (depth[:55] == 0).all(), "too near"
    assert (depth[425:] == 0).all(), "too far"
    assert (depth[205:255] == 0).all(), "grazing"
    # The projector is 7.5 cm to the right: its shadow is 585 * 0.075 * (1/1 - 1/2) = 22 px wide, on the left.
    missing = (depth[80:190] == 0).mean(axis=0)
    assert missing[281:297].min() > 0.95
    assert missing[100:270].max() == 0
    assert missing[310:390].max() == 0
    assert missing[405:600].max() == 0


def test_block_noise_is_standard() -> None:
    field = block_noise(480, 640, np.uint64(9))
    assert abs(field.mean()) < 0.05
    assert field.std() == pytest.approx(1, abs=0.05)


def test_colour_noise() -> None:
    grey = np.full((200, 200, 3), 128, np.uint8)
    noise = noisy_colour(grey, 0, 0).astype(float) - 128
    assert noise.std() == pytest.approx(3, rel=0.1)
    assert abs(noise.mean()) < 0.1
    assert (noisy_colour(np.full_like(grey, 255), 0, 0) > 230).all(), "clipped, not wrapped"


@pytest.mark.parametrize(
    ("name", "seed", "kind"),
    [
        ("scene", 0, "table"),
        ("scene:4", 4, "table"),
        ("scene:4:cluttered", 4, "cluttered"),
        ("scene:cluttered", 0, "cluttered"),
        ("scene:2:desk", 2, "desk"),
        ("scene:desk", 0, "desk"),
        ("scene:3:near", 3, "near"),
        ("scene:1:shelf", 1, "shelf"),
        ("scene:1:bin", 1, "bin"),
        ("scene:1:changing", 1, "changing"),
    ],
)
def test_scene_by_name(name: str, seed: int, kind: SceneKind) -> None:
    found = open_source(name, frames=9)
    assert isinstance(found, Scene)
    assert (found.seed, found.kind, len(found)) == (seed, kind, 9)


def test_scene_has_its_own_camera() -> None:
    with pytest.raises(SourceError, match="own camera"):
        open_source("scene", intrinsics=(1, 1, 1, 1))
