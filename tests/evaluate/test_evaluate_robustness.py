"""Sequences made worse: the errors' statistics, that they repeat, and the table of what is left."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from evaluate_samples import write_osd, write_png
from typer.testing import CliRunner

from spot3d.camera import Intrinsics, invert
from spot3d.cli.evaluate import evaluate
from spot3d.depth_noise import KINECT_V1
from spot3d.evaluate.degraded import SEED, Degradation
from spot3d.evaluate.faults import (
    Pose,
    bent,
    blurred,
    darkened,
    fattened,
    late,
    misplaced,
    mixed,
    noisier,
    shaken,
    torn,
)
from spot3d.evaluate.object_tables import OURS
from spot3d.evaluate.peer import PEER
from spot3d.evaluate.robustness import (
    BENT,
    BLURRED,
    FATTENED,
    FOCALS,
    GROUPS,
    MIXED,
    MOUNTS,
    PHOTONS,
    SCALES,
    SHAKES,
    groups,
)
from spot3d.source.errors import SourceError
from spot3d.source.halving import Halved
from spot3d.source.scene.scene import Scene

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(evaluate)

VGA = Intrinsics(585.0, 585.0, 320.0, 240.0, 640, 480)
HALF = VGA.halved()


def test_shaken_poses_have_the_stated_statistics() -> None:
    poses: list[Pose] = [np.eye(4)] * 20_000
    errors = np.array(shaken(poses, 0.01, 0.4, seed=1))
    shifts = errors[:, :3, 3]
    # 1000 independent stretches of 20 frames: deviations are good to about 3 %.
    np.testing.assert_allclose(shifts.std(axis=0), 0.01, rtol=0.08)
    np.testing.assert_allclose(np.degrees([errors[:, 2, 1].std(), errors[:, 0, 2].std()]), 0.4, rtol=0.08)
    for lag in (1, 10, 20):
        alike = (shifts[lag:] * shifts[:-lag]).mean() / (shifts**2).mean()
        assert alike == pytest.approx(np.exp(-lag / 10), abs=0.06)


def test_shaking_repeats_and_is_in_the_cameras_frame() -> None:
    T = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], np.float64)
    at_origin, elsewhere = (shaken([pose] * 5, 0.01, 0.4, seed=1) for pose in (np.eye(4), T))
    for error, moved in zip(at_origin, elsewhere, strict=True):
        assert error is not None
        np.testing.assert_allclose(moved, T @ error, atol=1e-12)
        np.testing.assert_allclose(error @ invert(error), np.eye(4), atol=1e-12)
    again, other = shaken([T] * 5, 0.01, 0.4, seed=1), shaken([T] * 5, 0.01, 0.4, seed=2)
    np.testing.assert_array_equal(elsewhere, again)
    assert not np.allclose(elsewhere, other)
    np.testing.assert_array_equal(shaken([T] * 5, 0, 0, seed=1), [T] * 5)
    first, missing, last = shaken([np.eye(4), None, np.eye(4)], 0.01, 0.4, seed=1)
    assert missing is None
    np.testing.assert_array_equal([first, last], [at_origin[0], at_origin[2]])


def test_late_poses() -> None:
    poses: list[Pose] = [np.full((4, 4), float(k)) for k in range(4)]
    assert [int(pose[0, 0]) for pose in late(poses, 2) if pose is not None] == [0, 0, 0, 1]
    assert late(poses, 0) == poses
    assert late([], 2) == []


@pytest.mark.parametrize("camera", [VGA, HALF])
@pytest.mark.parametrize("z", [0.6, 1.5])
def test_noisier_depth_has_the_stated_deviation(camera: Intrinsics, z: float) -> None:
    depth = np.full(camera.shape, z, np.float32)
    depth[:, :50] = 0
    worse = noisier(depth, camera, 2.0, (1, 7))
    added = (worse - depth)[:, 50:]
    # Sensor's noise and what is added, independent of each other: together twice the sensor's.
    assert np.hypot(added.std(), KINECT_V1.sigma(z)) == pytest.approx(2 * KINECT_V1.sigma(z), rel=0.06)
    assert abs(added.mean()) < 0.1 * KINECT_V1.sigma(z)
    assert not worse[:, :50].any()
    step = 7 if camera is VGA else 4
    beside, beyond = (np.corrcoef(added[:, :-k].ravel(), added[:, k:].ravel())[0, 1] for k in (1, step + 1))
    assert beside > 0.6, "alike within a block of the sensor"
    assert abs(beyond) < 0.1, "and not beyond"
    np.testing.assert_array_equal(worse, noisier(depth, camera, 2.0, (1, 7)))
    assert not np.array_equal(worse, noisier(depth, camera, 2.0, (1, 8)))
    assert noisier(depth, camera, 1.0, (1, 7)) is depth


@pytest.mark.parametrize("share", [0.1, 0.3])
@pytest.mark.parametrize("camera", [VGA, HALF])
def test_torn_depth_loses_its_share_in_blobs(camera: Intrinsics, share: float) -> None:
    depth = np.full(camera.shape, 1.2, np.float32)
    depth[:, :100] = 0
    worse = torn(depth, camera, share, (1, 7))
    lost = (depth > 0) & (worse == 0)
    assert np.count_nonzero(lost) == round(share * np.count_nonzero(depth))
    np.testing.assert_array_equal(worse[~lost], depth[~lost])
    beside = lost[:, 101:][lost[:, 100:-1]].mean()
    assert beside > 0.8, "a lost pixel's neighbour is lost too"
    np.testing.assert_array_equal(worse, torn(depth, camera, share, (1, 7)))
    assert not np.array_equal(worse, torn(depth, camera, share, (1, 8)))
    assert torn(depth, camera, 0.0, (1, 7)) is depth
    assert not torn(np.zeros_like(depth), camera, share, (1, 7)).any()


def test_bent_depth_is_as_long_on_the_whole_and_bent_alike_in_every_frame() -> None:
    depth = np.full(HALF.shape, 2.0, np.float32)
    depth[:10] = 0
    worse = bent(depth, 0.01, 1)
    assert not worse[:10].any(), "what is invalid stays so"
    share = bent(np.ones_like(depth), 0.01, 1) - 1
    assert share.mean() == pytest.approx(0, abs=1e-6)
    assert share.std() == pytest.approx(0.01, rel=1e-3)
    assert np.abs(np.diff(share, axis=1)).max() < 0.001, "it is smooth"
    np.testing.assert_allclose(worse[10:], 2 * (1 + share[10:]), rtol=1e-6)
    assert not np.allclose(worse, bent(depth, 0.01, 2)), "another camera is bent otherwise"
    scene = Scene(1, frames=1)
    frame = Degradation(bent=0.01).of(scene)[0]
    np.testing.assert_array_equal(frame.depth, bent(scene[0].depth_metres(), 0.01, SEED))


def test_mixed_depth_is_a_mean_of_what_is_valid() -> None:
    depth = np.full(HALF.shape, 1.0, np.float32)
    depth[:, 100:], depth[:, 200:] = 2.0, 0
    worse = mixed(depth, 1)
    np.testing.assert_allclose(worse[50, 97:103], [1, 1, 4 / 3, 5 / 3, 2, 2], rtol=1e-6)
    np.testing.assert_allclose(worse[50, 197:203], [2, 2, 2, 0, 0, 0], rtol=1e-6)
    frame = Degradation(mixed=2).of(Scene(1, frames=1))[0]
    np.testing.assert_array_equal(frame.depth, mixed(Scene(1, frames=1)[0].depth_metres(), 2))


def test_near_things_grow_over_what_is_behind_them_and_nothing_else_changes() -> None:
    depth = np.full(HALF.shape, 2.0, np.float32)
    depth[40:60, 100:120] = 1.0
    depth[:, 200:] = 0
    depth[:, :40] = 2.4 - 0.01 * np.arange(40, dtype=np.float32)
    worse = fattened(depth, 2)
    near = np.zeros(depth.shape, np.bool_)
    near[38:62, 98:122] = True
    np.testing.assert_array_equal(worse[near], 1)
    np.testing.assert_array_equal(worse[~near], depth[~near])
    frame = Degradation(fattened=1).of(Scene(1, frames=1))[0]
    np.testing.assert_array_equal(frame.depth, fattened(Scene(1, frames=1)[0].depth_metres(), 1))


def test_darkened_colour_has_so_many_photons() -> None:
    colour = np.full((200, 300, 3), 255, np.uint8)
    colour[:, 100:] = 51
    worse = darkened(colour, 20, (1, 7)).astype(np.float64)
    dark = worse[:, 100:]
    # Of 4 photons: as many in the mean, and a deviation of 2 (the darkest are not cut off, the brightest hardly).
    assert dark.mean() == pytest.approx(51, rel=0.02)
    assert dark.std() == pytest.approx(51 / 2, rel=0.05)
    assert not np.array_equal(worse, darkened(colour, 20, (1, 8)))
    assert not darkened(colour, 0, (1, 7)).any()
    scene = Scene(1, frames=2)
    frame = Degradation(photons=20).of(scene)[1]
    np.testing.assert_array_equal(frame.colour, darkened(scene[1].colour, 20, (SEED, 1)))
    np.testing.assert_array_equal(frame.depth, scene[1].depth_metres())


def test_blurred_colour_is_smeared_along_a_line() -> None:
    colour = np.zeros((101, 101, 3), np.uint8)
    colour[50, 50] = 255
    worse = blurred(colour, 15, (1, 7))
    v, u = np.nonzero(worse[..., 0])
    np.testing.assert_allclose((v.mean(), u.mean()), 50)
    assert 10 < len(v) <= 15
    assert worse[..., 0].sum(dtype=np.int64) == pytest.approx(255, abs=15)
    across = np.linalg.svd(np.column_stack((v, u)) - 50.0)[1]
    assert across[1] < 0.2 * across[0], "a line"
    assert not np.array_equal(worse, blurred(colour, 15, (1, 8))), "in another direction"
    scene = Scene(1, frames=2)
    np.testing.assert_array_equal(
        Degradation(blurred=1 / 40).of(scene)[1].colour, blurred(scene[1].colour, 16, (SEED, 1))
    )


def test_misplaced_poses_are_of_what_is_fixed_to_the_camera() -> None:
    poses = Scene(1, frames=4)
    true = [poses.true_pose(k) for k in range(4)]
    told = misplaced([*true, None], 0.02, 1.0, 1)
    assert told[4] is None
    errors = [invert(a) @ b for a, b in zip(true, told, strict=False) if a is not None and b is not None]
    assert len(errors) == 4
    for error in errors:
        np.testing.assert_allclose(error, errors[0], atol=1e-12)
    assert np.linalg.norm(errors[0][:3, 3]) == pytest.approx(0.02)
    assert np.degrees(np.arccos((np.trace(errors[0][:3, :3]) - 1) / 2)) == pytest.approx(1.0)
    worse = Degradation(mount=(0.02, 1.0)).of(poses)
    np.testing.assert_array_equal([frame.T_world_camera for frame in worse], told[:4])


def test_degradations_work_with_one_another() -> None:
    scene = Scene(1, frames=6)
    worse = Degradation(metres=0.01, degrees=0.4, late=1, noise=2.0, missing=0.3).of(scene)
    true = [scene.true_pose(index) for index in range(6)]
    told = shaken([true[0], *true[:5]], 0.01, 0.4, 1)
    np.testing.assert_array_equal([frame.T_world_camera for frame in worse], told)
    frame, exact = worse[3], scene[3]
    np.testing.assert_array_equal(frame.T_world_camera, told[3])
    np.testing.assert_array_equal(worse.true_pose(3), true[3])
    np.testing.assert_array_equal(worse[-3].depth, frame.depth)
    np.testing.assert_array_equal(frame.colour, exact.colour)
    assert np.count_nonzero(frame.depth) == pytest.approx(0.7 * np.count_nonzero(exact.depth), abs=1)
    assert (len(worse), len(list(worse)), worse.stamps_ns) == (6, 6, scene.stamps_ns)
    assert (worse.rate_hz, worse.intrinsics, worse.has_true_poses) == (30, scene.intrinsics, True)
    assert Halved(worse)[3].intrinsics == scene.intrinsics.halved()
    kept = Degradation(missing=0.1).of(scene)
    np.testing.assert_array_equal(kept[2].T_world_camera, true[2])


def test_errors_are_those_of_neighbours_whichever_frames_are_taken() -> None:
    scene = Scene(1, frames=9)
    level = Degradation(metres=0.01, degrees=0.4, late=1, noise=2.0, missing=0.1)
    every, third = level.of(scene), replace(level, every=3).of(scene)
    assert (len(every), len(third)) == (9, 3)
    np.testing.assert_array_equal(every[6].T_world_camera, third[2].T_world_camera)
    np.testing.assert_array_equal(every[6].depth, third[2].depth)
    assert replace(level, every=3, half=True).of(scene)[1].intrinsics == scene.intrinsics.halved()
    assert Degradation().of(scene) is scene


def test_scaled_depth() -> None:
    scene = Scene(1, frames=2)
    worse = Degradation(scale=1.03).of(scene)
    np.testing.assert_allclose(worse[1].depth_metres(), 1.03 * scene[1].depth_metres(), rtol=1e-5)
    np.testing.assert_array_equal(worse[1].T_world_camera, scene[1].T_world_camera)


def test_wrong_focal_length() -> None:
    scene = Scene(1, frames=2)
    worse = Degradation(focal=1.03, centre=0.0125).of(scene)
    true, told = scene[1].intrinsics, worse[1].intrinsics
    assert (told.fx, told.fy) == pytest.approx((1.03 * true.fx, 1.03 * true.fy))
    assert (told.cx, told.cy) == (true.cx, true.cy + 0.0125 * true.width)
    assert worse.intrinsics == told
    np.testing.assert_array_equal(worse[1].depth_metres(), scene[1].depth_metres())


def test_levels() -> None:
    base = Degradation(every=3)
    kinds = groups(base)
    assert tuple(kinds) == GROUPS
    assert GROUPS == (
        "poses",
        "delay",
        "mount",
        "centre",
        "focal",
        "scale",
        "bent",
        "depth",
        "edges",
        "holes",
        "colour",
        "every",
        "together",
        "half",
    )
    assert all(base in dict(levels).values() for levels in kinds.values())
    assert [(level.metres, level.degrees) for _, level in kinds["poses"]] == [(0, 0), *SHAKES]
    assert [level.late for _, level in kinds["delay"]] == [0, 1, 2]
    assert [level.mount for _, level in kinds["mount"]] == [(0, 0), *MOUNTS]
    assert [level.focal for _, level in kinds["focal"]] == [1, *FOCALS]
    assert [level.scale for _, level in kinds["scale"]] == [1, *SCALES]
    assert [level.bent for _, level in kinds["bent"]] == [0, *BENT]
    assert [level.noise for _, level in kinds["depth"]] == [1, 2]
    edges = [(0, 0), *((reach, 0) for reach in MIXED), *((0, reach) for reach in FATTENED)]
    assert [(level.mixed, level.fattened) for _, level in kinds["edges"]] == edges
    assert [level.missing for _, level in kinds["holes"]] == [0, 0.1, 0.3]
    colour = [(np.inf, 0), *((photons, 0) for photons in PHOTONS), (np.inf, BLURRED)]
    assert [(level.photons, level.blurred) for _, level in kinds["colour"]] == colour
    assert [level.every for _, level in kinds["every"]] == [1, 2, 3, 4, 5, 10, 20, 30]
    together = [level for _, level in kinds["together"]]
    assert [(level.metres, level.scale, level.late, level.noise, level.centre) for level in together] == [
        (0, 1, 0, 1, 0),
        (0.01, 0.97, 0, 1, 0),
        (0.01, 1.03, 0, 1, 0),
        (0.01, 0.97, 1, 2, 0),
        (0, 0.97, 0, 1, 0.025),
    ]
    assert kinds["together"][-1][0] == "x 0.97, +16 of 640 px"


def test_table_and_curves(tmp_path: Path) -> None:
    words = ["robustness", "scene:2", "--every", "12", "--frames", "2", "--half", "--only", "poses,half"]
    words += ["--plots", str(tmp_path), "--json", str(tmp_path / "numbers.json")]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0
    (table,) = json.loads((tmp_path / "numbers.json").read_text())["tables"]
    worse = ["nothing", *(f"poses: {1e3 * m:g} mm {d:g} deg" for m, d in SHAKES)]
    assert [(row["worse"], row["method"]) for row in table["rows"]] == [(w, m) for w in worse for m in (OURS, PEER)]
    assert {curve["data"] for curve in table["curves"]} == {"scene:2 poses"}, "half size is the base already"
    for curve in table["curves"]:
        assert len(curve["rate"]) == len(curve["levels"]) == 4
    undegraded = table["rows"][0]
    assert table["curves"][0]["rate"][0] == undegraded["3D DR"]
    assert {row["lost %"] for row in table["rows"]} == {0}
    assert [path.name for path in tmp_path.glob("*.png")] == ["robustness-scene-2-poses.png"]
    assert "24 frames of 320x240, every 12 unless stated" in result.stdout
    assert "scene:2: not measured at half size again" in result.stdout


def test_shaken_poses_are_given_ones(tmp_path: Path) -> None:
    words = ["robustness", "scene:2", "--every", "5", "--frames", "3", "--half", "--only", "poses", "--pose", "kiss"]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert "are given poses; with odometry" in result.stdout
    assert "poses: " not in result.stdout.partition("\n- ")[0]


@pytest.mark.parametrize(
    "words",
    [
        ["robustness", "scene:2", "--only", "poses,wind"],
        ["robustness", "scene:2", "--only", ""],
        ["points", "scene:2", "--only", "poses"],
    ],
)
def test_kinds_are_known_ones(words: list[str]) -> None:
    assert "choose from poses, delay" in str(CliRunner().invoke(app, words).exception)


def test_frames_by_themselves_are_degraded_too(tmp_path: Path) -> None:
    write_osd(tmp_path)
    words = ["robustness", str(tmp_path), "--only", "poses,scale,bent", "--json", str(tmp_path / "numbers.json")]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0
    (table,) = json.loads((tmp_path / "numbers.json").read_text())["tables"]
    worse = ["nothing", *(f"scale: x {k:g}" for k in SCALES), *(f"bent: {100 * k:g} %" for k in BENT)]
    assert [row["worse"] for row in table["rows"]] == worse
    assert {curve["data"].split()[-1] for curve in table["curves"]} == {"scale", "bent"}
    assert table["curves"][0]["rate"][0] == table["rows"][0]["ours DR"]


def test_robustness_needs_true_objects(tmp_path: Path) -> None:
    write_png(tmp_path / "frame-000000.color.png", np.zeros((48, 64, 3), np.uint8))
    write_png(tmp_path / "frame-000000.depth.png", np.full((48, 64), 1500, np.uint16))
    with pytest.raises(SourceError, match="true objects"):
        CliRunner().invoke(app, ["robustness", str(tmp_path), "--intrinsics", "50,50,32,24"], catch_exceptions=False)
