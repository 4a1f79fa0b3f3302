"""The fusion stage's core on a room of cuboids, seen by a noisy camera."""

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE, COARSE_PAPER, ROOM, THREE, Cuboid, look_at, orbit, rotation_z, view
from numpy.typing import NDArray
from voting_room import keyframe

from spot3d.boxes import iou_matrix_3d, moved
from spot3d.calibration import Calibration
from spot3d.camera import Intrinsics
from spot3d.camera_pose import CameraPose
from spot3d.found_object import FoundObjects
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.settings import MAP_ALONE, FusionSettings
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_from_vector

OF_THE_MAP = {
    "plane_triples": 10,
    "plane_candidates": 1,
    "plane_search": "triples",
    "plane_heat_max": 1.0,
    "plane_pixels": "keyframe",
    "keyframe_interval": 3,
    "plane_removal": False,
    "colour_gate": 0.01,
    "depth_gate": 0.1,
    "noise_gate": 0.0,
    "noise_weighting": False,
    "look_up": False,
    "voxel": 0.02,
    "map_limit": 1000,
    "frequency_min": 100,
    "frequency_share": 1.0,
    "tau": 1000.0,
    "density_radius": 0.2,
    "density_points": 1000,
    "density_cell": 0.1,
    "seed": 1,
}
"""Settings that change the map, and another value of each."""


def run(
    fusion: Fusion,
    objects: tuple[Cuboid, ...] = THREE,
    frames: int = 10,
    seed: int = 0,
    maps: list[NDArray[np.float64]] | None = None,
    another_from: int = 10,
) -> Fusion:
    """Fuse frames along an arc, each a keyframe with perfect labels.

    maps: where the map of poses lies, in each. another_from: from this frame on somebody else gives the poses, whose
    map is the world.
    """
    rng = np.random.default_rng(seed)
    for stamp, pose in enumerate(orbit(frames)):
        seen = view(pose, ROOM + objects, rng)
        T_world_map = np.eye(4) if maps is None else maps[stamp]
        by, told = ("first", T_world_map) if stamp < another_from else ("another", np.eye(4))
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(T_world_map @ pose, told, by), stamp)
        true = keyframe(pose, objects)
        assert fusion.observe(FrameSegments(true.labels, true.heat, true.planes, true.stands_on, CAMERA), stamp)
    return fusion


@pytest.fixture(scope="module")
def fused() -> Fusion:
    return run(Fusion(COARSE))


def described(update: FoundObjects) -> list[tuple[object, ...]]:
    return [
        (o.id, o.confidence, o.views, o.points, *o.colour, *o.box.centre, *o.box.size, *o.box.rotation.ravel())
        for o in update.objects
    ]


def test_depth_of_another_scale_than_the_poses() -> None:
    """It is known from the fifth frame on; whoever gives poses from the eighth on does not know it yet."""
    fusion, right = Fusion(COARSE), run(Fusion(COARSE)).objects()
    for stamp, pose in enumerate(orbit(10)):
        seen, true = view(pose, ROOM + THREE, np.random.default_rng(stamp)), keyframe(pose, THREE)
        depth, factor = seen.depth / np.float32(1.04), 1.04 if 5 <= stamp < 8 else 1.0
        by = "first" if stamp < 8 else "another"
        known = CameraPose(pose, given_by=by, calibration=Calibration(factor))
        fusion.fuse(seen.colour, depth, seen.heat, CAMERA, known, stamp)
        planes = true.planes / (1, 1, 1, 1.04)
        fusion.observe(FrameSegments(true.labels, true.heat, planes, true.stands_on, CAMERA), stamp)
        if stamp in (3, 6):
            fusion.objects()
    iou = iou_matrix_3d([item.box for item in right.objects], [item.box for item in fusion.objects().objects])
    assert iou.shape == (3, 3)
    assert iou.max(axis=1).min() > 0.85


def test_poses_that_are_known_better_later() -> None:
    """Poses are 2 cm and 1 deg off, each otherwise, in a map that lies at a slant in the world; the last frame brings
    what they lack, in the world's axes."""
    T_world_map = np.eye(4)
    T_world_map[:3, :3], T_world_map[:3, 3] = rotation_from_vector(np.array((0.1, -0.2, 0.8))), (0.5, -0.3, 0.2)
    off = np.repeat((0.02, np.radians(1.0)), 3) * np.random.default_rng(0).normal(size=(10, 6))
    corrections = PoseCorrections(np.arange(10), -off)
    boxes = {}
    for name, known in (("known", corrections), ("unknown", None)):
        fusion = Fusion(COARSE)
        for stamp, pose in enumerate(orbit(10)):
            seen, true = view(pose, ROOM + THREE, np.random.default_rng(stamp)), keyframe(pose, THREE)
            told = T_world_map @ pose
            told[:3, :3] = rotation_from_vector(off[stamp, 3:]) @ told[:3, :3]
            told[:3, 3] += off[stamp, :3]
            last = known if stamp == 9 else None
            given = CameraPose(told, T_world_map, corrections=last)
            fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, given, stamp)
            fusion.observe(FrameSegments(true.labels, true.heat, true.planes, true.stands_on, CAMERA), stamp)
            if stamp == 5:
                fusion.objects()
        boxes[name] = [moved(item.box, np.linalg.inv(T_world_map)) for item in fusion.objects().objects]
    right = [item.box for item in run(Fusion(COARSE)).objects().objects]
    known, unknown = (iou_matrix_3d(right, found).max(axis=1).mean() for found in boxes.values())
    assert known > 0.9
    assert unknown < known - 0.1


def test_what_one_corrects_is_not_what_another_gives() -> None:
    """Corrections hold for what comes after the last of them, but not where somebody else gives the poses."""
    placed = {}
    for by in ("first", "another"):
        fusion = Fusion(COARSE)
        for stamp, pose in enumerate(orbit(4)):
            seen, true = view(pose, ROOM + THREE), keyframe(pose, THREE)
            given_by, known = ("first" if stamp < 2 else by), PoseCorrections(np.arange(1), np.full((1, 6), 0.01))
            last = known if stamp == 1 else None
            given = CameraPose(pose, np.eye(4), given_by, corrections=last)
            fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, given, stamp)
            fusion.observe(FrameSegments(true.labels, true.heat, true.planes, true.stands_on, CAMERA), stamp)
            if stamp == 1:
                fusion.objects()
        fusion.objects()
        placed[by] = [sum(seen.twist) > 0 for seen in fusion.consensus._graph._placed.values()]
    assert placed == {"first": [True] * 4, "another": [True, True, False, False]}


@pytest.mark.parametrize(("then", "expected"), [("first", 1.0), ("another", 1.04)])
def test_a_correction_is_taken_back_by_who_gave_it(then: str, expected: float) -> None:
    """Also after a restart of fusion; another process that gives poses has only not found it yet."""
    fusion, pose = Fusion(COARSE), look_at((0.0, -0.95, 0.7))
    seen = view(pose, ROOM)

    def fuse(factor: float, by: str) -> float:
        known = CameraPose(pose, given_by=by, calibration=Calibration(depth_factor=factor))
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, known)
        return fusion.map_state().calibration.depth_factor

    assert [fuse(factor, "first") for factor in (1.0, 1.04)] == [1.0, 1.04]
    assert [fuse(1.0, then), fuse(1.0, then)] == [expected, expected]
    assert fuse(1.04, "first") == 1.04
    fusion.resume(fusion.map_state(), fusion.consensus, fusion.identities)
    assert [fuse(1.0, then), fuse(1.0, then)] == [expected, expected]


def test_before_the_first_frame_there_is_nothing() -> None:
    update = Fusion(COARSE).objects()
    assert (update.objects, update.frame_count) == ([], 0)
    np.testing.assert_array_equal(update.up, [0, 0, 1])


def test_every_object_is_found_and_nothing_else(fused: Fusion) -> None:
    update = fused.objects()
    iou = iou_matrix_3d([cuboid.box() for cuboid in THREE], [item.box for item in update.objects])
    assert iou.shape == (3, 3)
    assert (iou.max(axis=1) >= 0.8).all()
    assert update.up[2] > np.cos(np.deg2rad(1))
    assert update.frame_count == 10


def test_the_same_input_gives_the_same_objects(fused: Fusion) -> None:
    again = run(Fusion(COARSE))
    np.testing.assert_array_equal(again.heatmap.points(), fused.heatmap.points())
    assert described(again.objects()) == described(fused.objects())


@pytest.mark.parametrize(("name", "value"), OF_THE_MAP.items())
def test_what_is_of_the_map_alone_has_no_part_in_the_objects(fused: Fusion, name: str, value: float | str) -> None:
    found, expected = run(Fusion(COARSE.model_copy(update={name: value}))).objects(), fused.objects()
    assert described(found) == described(expected)
    np.testing.assert_array_equal(found.up, expected.up)


def test_what_is_of_the_map_alone_says_so() -> None:
    fields = FusionSettings.model_fields.items()
    assert {name for name, field in fields if (field.description or "").endswith(MAP_ALONE)} == OF_THE_MAP.keys()


def test_numbers_stay_from_update_to_update(fused: Fusion) -> None:
    first, second = fused.objects(), fused.objects()
    assert described(first) == described(second)
    assert [item.id for item in first.objects] == [1, 2, 3]


def test_objects_move_with_the_map_of_poses(fused: Fusion) -> None:
    """The map is found to lie 3 cm higher and turned by a degree, little by little: the boxes do not grow by it."""
    maps = [np.eye(4) for _ in range(10)]
    for step, T in enumerate(maps):
        T[:3, :3], T[2, 3] = rotation_z(step / 9 * np.deg2rad(1)), step / 9 * 0.03
    slid, stayed = run(Fusion(COARSE), maps=maps).objects(), fused.objects()
    assert len(slid.objects) == 3
    for ours, theirs in zip(slid.objects, stayed.objects, strict=True):
        np.testing.assert_allclose(ours.box.size, theirs.box.size, atol=1e-4)
        np.testing.assert_allclose(ours.box.centre, moved(theirs.box, maps[-1]).centre, atol=1e-4)
    np.testing.assert_allclose(slid.up, stayed.up, atol=1e-6)


def test_objects_stay_when_another_process_gives_the_poses(fused: Fusion) -> None:
    """What it takes for the world's own map is the map of before as it lay last."""
    slid = [np.eye(4) for _ in range(10)]
    for T in slid[3:]:
        T[2, 3] = 0.03
    found = run(Fusion(COARSE), maps=slid, another_from=6).objects().objects
    for ours, before in zip(found, fused.objects().objects, strict=True):
        assert ours.id == before.id
        np.testing.assert_allclose(ours.box.centre, moved(before.box, slid[-1]).centre, atol=2e-3)
        np.testing.assert_allclose(ours.box.size, before.box.size, atol=2e-3)


def test_reset_starts_anew(fused: Fusion) -> None:
    fusion = run(Fusion(COARSE), frames=3, seed=9)
    fusion.objects()
    fusion.reset()
    assert (fusion.frame_count, fusion.heatmap.count, fusion.objects().objects) == (0, 0, [])
    assert described(run(fusion).objects()) == described(fused.objects())


def test_a_snapshot_does_not_change_when_fusing_goes_on() -> None:
    fusion = run(Fusion(COARSE))
    expected = described(fusion.objects())
    task = fusion.snapshot()
    run(fusion, objects=THREE[:1], frames=4, seed=5)
    late = task()
    assert described(late) == expected
    assert late.frame_count == 10


def test_an_update_of_before_a_reset_leaves_nothing_behind(fused: Fusion) -> None:
    """It may still be running when the reset comes: what it finds is of the map that is no more."""
    fusion = run(Fusion(COARSE), frames=4, seed=9)
    task = fusion.snapshot()
    fusion.reset()
    run(fusion)
    assert len(task().objects) == 3
    assert described(fusion.objects()) == described(fused.objects())


def test_the_papers_preset_finds_separated_objects() -> None:
    """By a camera that turns by four degrees from frame to frame: a keyframe's points are the table's for ten."""
    fusion = run(Fusion(COARSE_PAPER), frames=24)
    iou = iou_matrix_3d([c.box() for c in THREE], [item.box for item in fusion.objects().objects])
    assert (iou.max(axis=1, initial=0) > 0.3).all()


def test_removing_the_plane_takes_its_heat() -> None:
    kept = run(Fusion(COARSE.model_copy(update={"plane_removal": False})), frames=6)
    removed = run(Fusion(COARSE), frames=6)
    table = [
        p.heat[(np.abs(p.xyz[:, 2]) < 0.005) & (np.abs(p.xyz[:, :2]) < 0.5).all(axis=1)].mean()
        for p in (kept.frequent_points(), removed.frequent_points())
    ]
    assert table[1] < 0.2 * table[0]
    assert kept.objects().up[2] > 0.99  # even then the direction of up is known


@pytest.mark.parametrize("width", [160, 80])
def test_frames_without_depth_and_read_only_frames_are_taken(width: int) -> None:
    fusion = Fusion(COARSE.model_copy(update={"lattice_width": width}))
    pose = look_at((0.0, -0.95, 0.7))
    seen = view(pose, ROOM + THREE)
    for array in (seen.colour, seen.depth, seen.heat):
        array.setflags(write=False)
    assert fusion.fuse(seen.colour, np.zeros_like(seen.depth), seen.heat, CAMERA, CameraPose(pose)).appended == 0
    assert fusion.objects().objects == []
    assert fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose)).appended > 0
    assert fusion.frame_count == 2


def test_who_gives_frames_may_use_their_memory_again() -> None:
    """At the lattice's own size nothing else copies them."""
    camera, rng = Intrinsics(285.0, 285.0, 159.5, 119.5, 320, 240), np.random.default_rng(0)
    colours = [rng.integers(0, 256, (*camera.shape, 3), np.uint8) for _ in range(2)]
    depth, heat, counts = np.ones(camera.shape, np.float32), np.zeros(camera.shape, np.uint8), []
    for reuse in (False, True):
        fusion = Fusion(FusionSettings(plane_removal=False, look_up=False))
        first = colours[0].copy()
        fusion.fuse(first, depth, heat, camera, CameraPose(np.eye(4)))
        if reuse:
            first[:] = colours[1]
        counts.append(fusion.fuse(first if reuse else colours[1], depth, heat, camera, CameraPose(np.eye(4))).warped)
    assert counts[0] == counts[1] < 0.1 * depth.size
