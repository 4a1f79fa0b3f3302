"""Loaders of data sets: made-up samples, and what each says when something is missing."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from evaluate_samples import uw_cloud, write_osd, write_png, write_rgbd_scenes, write_uw_scenes

from spot3d.camera import Intrinsics
from spot3d.evaluate.datasets import (
    at_half_size,
    both_sizes,
    dataset_kind,
    datasets_below,
    distinctly_named,
    open_dataset,
)
from spot3d.evaluate.frame_tables import judged_overlap
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.ply import read_ply_points
from spot3d.evaluate.points import IGNORED
from spot3d.evaluate.scores import without_object
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.source.scene.name import scene_names


def test_osd(tmp_path: Path) -> None:
    write_osd(tmp_path)
    dataset = open_dataset(str(tmp_path), Settings())
    assert (dataset_kind(tmp_path), dataset.sequences) == ("OSD", ())
    first, second = dataset.frames
    np.testing.assert_array_equal(first.boxes, [[5, 10, 20, 10], [40, 30, 4, 1]])
    assert second.boxes.shape == (0, 4), "learn10 comes after learn2"
    assert first.frame.depth_metres()[0, 0] == pytest.approx(1.5)
    assert first.frame.intrinsics.fx == 525
    half = at_half_size(dataset)
    np.testing.assert_array_equal(half.readers[0]().boxes, [[2.5, 5, 10, 5], [20, 15, 2, 0.5]])


def test_a_folder_in_osds_layout_has_a_camera_of_its_own(tmp_path: Path) -> None:
    write_osd(tmp_path)
    given = open_dataset(str(tmp_path), Settings(), intrinsics=(60.0, 61.0, 32.0, 24.0)).readers
    (tmp_path / "camera-intrinsics.txt").write_text("570.34 0 31.5\n0 570.34 23.5\n0 0 1\n")
    stated = open_dataset(str(tmp_path), Settings()).readers
    assert given[0]().frame.intrinsics == Intrinsics(60, 61, 32, 24, 64, 48)
    assert stated[0]().frame.intrinsics == Intrinsics(570.34, 570.34, 31.5, 23.5, 64, 48)
    (tmp_path / "camera-intrinsics.txt").write_text("570.34 0 319.5\n0 570.34 239.5\n0 0 1\n")
    misfit = open_dataset(str(tmp_path), Settings()).readers
    with pytest.raises(SourceError, match=r"camera-intrinsics\.txt.*outside the 64x48 image"):
        misfit[0]()


@pytest.mark.parametrize("shape", [(480, 640), (240, 320), (720, 1280)])
def test_osds_own_camera_is_that_of_its_own_size(tmp_path: Path, shape: tuple[int, int]) -> None:
    write_png(tmp_path / "image_color" / "learn0.png", np.full((*shape, 3), 90, np.uint8))
    write_png(tmp_path / "depth" / "learn0.png", np.full(shape, 1500, np.uint16))
    write_png(tmp_path / "annotation" / "learn0.png", np.ones(shape, np.uint8))
    frames = open_dataset(str(tmp_path), Settings()).readers
    if shape == (480, 640):
        assert frames[0]().frame.intrinsics == Intrinsics(525, 525, 319.5, 239.5, 640, 480)
    else:
        with pytest.raises(SourceError, match=rf"is {shape[1]}x{shape[0]}, and OSD's own intrinsics are for 640x480"):
            frames[0]()


def test_other_data_sets_keep_their_camera(tmp_path: Path) -> None:
    write_rgbd_scenes(tmp_path / "rgbd")
    write_uw_scenes(tmp_path / "uw")
    for name in (str(tmp_path / "rgbd"), str(tmp_path / "uw"), "scene"):
        with pytest.raises(SourceError, match="has its own camera"):
            open_dataset(name, Settings(), intrinsics=(60.0, 61.0, 32.0, 24.0))


def test_what_an_annotation_does_not_judge(tmp_path: Path) -> None:
    write_osd(tmp_path)
    annotation = np.ones((48, 64), np.uint8)
    annotation[10:20, 5:25], annotation[20:40, 30:60] = 2, 0
    write_png(tmp_path / "annotation" / "learn2.png", annotation)
    for dataset, size in ((open_dataset(str(tmp_path), Settings()), 1), (half_of_osd(tmp_path), 2)):
        item = dataset.readers[0]()
        found = np.array([[30, 20, 30, 20], [28, 8, 30, 20], [0, 40, 9, 8], [5, 10, 20, 10], [6, 10, 19, 25]]) / size
        iou, left_out = judged_overlap(item, found)
        assert (iou.shape, left_out) == ((1, 4), 1)
        assert iou[0, 2] == 1
        assert without_object([iou]) == 2, "a stray box on the table, and one half on what is not judged"
        assert judged_overlap(item, np.zeros((0, 4)))[0].shape == (1, 0)


def half_of_osd(folder: Path) -> DataSet:
    return at_half_size(open_dataset(str(folder), Settings()))


def test_an_annotation_in_colours_is_refused_with_what_to_do(tmp_path: Path) -> None:
    write_osd(tmp_path)
    write_png(tmp_path / "annotation" / "learn2.png", np.ones((48, 64, 3), np.uint8))
    frames = open_dataset(str(tmp_path), Settings()).readers
    with pytest.raises(SourceError, match=r"learn2\.png is not a mask .*; save the objects' numbers .* palette$"):
        frames[0]()


def test_osd_disparity(tmp_path: Path) -> None:
    write_osd(tmp_path)
    (tmp_path / "depth").rename(tmp_path / "disparity")
    frames = open_dataset(str(tmp_path), Settings(), every=2).readers
    assert len(frames) == 1
    assert frames[0]().frame.depth_metres()[0, 0] == pytest.approx(1.5)


def test_rgbd_scenes(tmp_path: Path) -> None:
    write_rgbd_scenes(tmp_path)
    frames = open_dataset(str(tmp_path), Settings()).readers
    boxes = [read().boxes.tolist() for read in frames]
    assert boxes == [[[5, 10, 20, 10], [0, 0, 4, 2]], [], [[5, 11, 20, 9]]]
    assert open_dataset(str(tmp_path / "desk" / "desk_1"), Settings()).readers
    assert frames[0]().frame.intrinsics.fx == 570.3


@pytest.mark.parametrize("units", [1000, 10_000])
def test_uw_scenes(tmp_path: Path, units: int) -> None:
    write_uw_scenes(tmp_path, units)
    (item,) = open_dataset(str(tmp_path), Settings()).sequences
    assert item.sequence[1].depth_metres()[0, 0] == pytest.approx(1.0)
    assert item.truth is not None
    assert item.truth.names == ("bowl", "bowl")
    np.testing.assert_allclose(item.truth.up, [0, 0, -1], atol=1e-6)
    for box in item.truth.boxes:
        np.testing.assert_allclose(box.size, 0.05, atol=1e-3)
    assert np.bincount(item.truth.label).tolist() == [2400, 216, 216]


REMOVED: list[tuple[Callable[[Path], None], str, str]] = [
    (write_osd, "annotation/learn2.png", "learn2.png is missing"),
    (write_osd, "depth/learn10.png", "learn10.png is missing"),
    (write_osd, "annotation", "the folder annotation is missing"),
    (write_osd, "image_color", "the folder image_color is missing"),
    (write_osd, "depth", "needs a folder depth or disparity"),
    (write_rgbd_scenes, "desk/desk_1.mat", "desk_1.mat is missing: it holds the true boxes"),
    (write_rgbd_scenes, "desk/desk_1/desk_1_2.png", "desk_1_2.png is missing"),
    (write_uw_scenes, "pc/01.ply", "01.ply is missing"),
    (write_uw_scenes, "pc/01.label", "01.label is missing"),
    (write_uw_scenes, "pc/01.pose", "01.pose is missing"),
    (write_uw_scenes, "imgs", "imgs/scene_NN is missing"),
    (write_uw_scenes, "imgs/scene_01/00001-depth.png", "00001-depth.png is missing"),
]


@pytest.mark.parametrize(("write", "removed", "message"), REMOVED)
def test_missing(tmp_path: Path, write: Callable[[Path], None], removed: str, message: str) -> None:
    write(tmp_path)
    (tmp_path / removed).rename(tmp_path.with_name(tmp_path.name + "-elsewhere"))
    with pytest.raises(SourceError, match=message):
        open_dataset(str(tmp_path), Settings())


BROKEN: list[tuple[Callable[[Path], None], str, str, str]] = [
    (write_rgbd_scenes, "desk/desk_1.mat", "not a MATLAB file", "is not a MATLAB file with bboxes"),
    (write_uw_scenes, "pc/01.ply", "ply\nend_header\n", "has no vertices with x, y, z"),
    (write_uw_scenes, "pc/01.ply", "solid", "is not a PLY file"),
    (write_uw_scenes, "pc/01.label", "3\n1\n2\n3\n", "does not match its cloud"),
    (write_uw_scenes, "pc/01.label", "a b", "it contains text that is not an integer"),
    (write_uw_scenes, "pc/01.label", "2832\n" + "11\n" * 2832, "unknown labels"),
    (write_uw_scenes, "pc/01.pose", "1 0 0 0 0 0\n", "01.pose:1 is malformed"),
    (write_uw_scenes, "pc/01.pose", "0 0 0 0 0 0 0\n", "01.pose:1 is malformed"),
    (write_uw_scenes, "pc/01.pose", "1 0 0 0 0 0 nan\n", "01.pose:1 is malformed"),
    (write_uw_scenes, "pc/01.pose", "\n", "contains no poses"),
]


@pytest.mark.parametrize(("write", "broken", "text", "message"), BROKEN)
def test_broken(tmp_path: Path, write: Callable[[Path], None], broken: str, text: str, message: str) -> None:
    write(tmp_path)
    (tmp_path / broken).write_text(text)
    with pytest.raises(SourceError, match=message):
        open_dataset(str(tmp_path), Settings())


def test_uw_scenes_with_depth_that_contradicts_the_cloud(tmp_path: Path) -> None:
    write_uw_scenes(tmp_path, 3000)
    with pytest.raises(SourceError, match="do not agree: 3000 units"):
        open_dataset(str(tmp_path), Settings())


def test_binary_ply(tmp_path: Path) -> None:
    xyz = uw_cloud()[0]
    rows = np.zeros(len(xyz), [("x", "<f8"), ("red", "u1"), ("y", "<f4"), ("z", "<f4")])
    rows["x"], rows["y"], rows["z"] = xyz.T
    properties = "property double x\nproperty uchar red\nproperty float y\nproperty float z\n"
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(xyz)}\n{properties}element face 0\n"
    faces = "property list uchar int vertex_indices\nend_header\n"
    path = tmp_path / "cloud.ply"
    path.write_bytes((header + faces).encode() + rows.tobytes())
    np.testing.assert_array_equal(read_ply_points(path), xyz)
    path.write_bytes((header + faces).encode() + rows[:-1].tobytes())
    with pytest.raises(SourceError, match=r"malformed|is truncated"):
        read_ply_points(path)


def test_unknown_folder(tmp_path: Path) -> None:
    assert dataset_kind(tmp_path) is None
    with pytest.raises(SourceError, match="not one of the data sets"):
        open_dataset(str(tmp_path), Settings())
    with pytest.raises(SourceError, match="is not a folder"):
        open_dataset(str(tmp_path / "nowhere"), Settings())
    with pytest.raises(SourceError, match="is not a folder"):
        datasets_below(tmp_path / "nowhere")


def test_datasets_below_a_root(tmp_path: Path) -> None:
    assert datasets_below(tmp_path) == []
    write_osd(tmp_path / "a")
    write_rgbd_scenes(tmp_path / "b")
    write_uw_scenes(tmp_path / "deeper" / "c")
    assert datasets_below(tmp_path) == [tmp_path / "a", tmp_path / "b", tmp_path / "deeper" / "c"]
    assert datasets_below(tmp_path / "a") == [tmp_path / "a"]


def test_data_sets_of_one_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    places = [tmp_path / "chess" / "seq-01", tmp_path / "fire" / "seq-01", tmp_path / "desk"]
    for place in places[:2]:
        write_uw_scenes(place)
    write_osd(places[2])
    told = distinctly_named({str(place): open_dataset(str(place), Settings()) for place in places})
    assert [dataset.name for dataset in told] == ["chess/seq-01", "fire/seq-01", "desk"]
    assert [dataset.sequences[0].name for dataset in told[:2]] == ["chess/seq-01/scene_01", "fire/seq-01/scene_01"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("", None),
        ("scene", ["scene"]),
        ("scene:3:cluttered", ["scene:3:cluttered"]),
        ("scenes:2", ["scene:0", "scene:1"]),
        ("scenes:1:cluttered", ["scene:0:cluttered"]),
        ("scenes:2:desk", ["scene:0:desk", "scene:1:desk"]),
        ("scenes:2:changing", ["scene:0:changing", "scene:1:changing"]),
        ("scene:2:table", None),
        ("scenes:0", None),
        ("scenery", None),
    ],
)
def test_scene_names(name: str, expected: list[str] | None) -> None:
    assert scene_names(name) == expected


def test_scene() -> None:
    dataset = open_dataset("scene:1", Settings(), every=40, frames=2)
    (item,) = dataset.sequences
    assert item.truth is not None
    assert len(item.sequence) == len(dataset.readers) == 2
    labelled = dataset.readers[1]()
    assert labelled.frame.stamp_ns == item.sequence.stamps_ns[1]
    assert 0 < len(labelled.boxes) <= len(item.truth.boxes)
    assert set(np.unique(item.truth.label)) >= {0, *item.truth.labels}
    sizes = [size for _, size in both_sizes([dataset])]
    assert sizes == ["640x480", "320x240"]
    assert [size for _, size in both_sizes([at_half_size(dataset)])] == ["320x240"]


def test_frames_of_several_scenes() -> None:
    both = open_dataset("scenes:2", Settings(), every=40, frames=1)
    alone = [open_dataset(f"scene:{seed}", Settings(), every=40, frames=1) for seed in range(2)]
    assert [item.boxes.tolist() for item in both.frames] == [next(one.frames).boxes.tolist() for one in alone]


def test_settings_may_halve_a_data_set() -> None:
    """As those of a run at half size do, with which it is measured; once, whoever asks for it again."""
    halved = Settings.model_validate({"source": {"halved": True}})
    asked = at_half_size(open_dataset("scene:0", Settings(), frames=30))
    told = open_dataset("scene:0", halved, frames=30)
    assert told.halved
    for dataset in (told, at_half_size(told)):
        one, other = dataset.readers[0](), asked.readers[0]()
        assert one.frame.depth.shape == other.frame.depth.shape == (240, 320)
        np.testing.assert_array_equal(one.boxes, other.boxes)
        assert dataset.sequences[0].sequence.intrinsics == asked.sequences[0].sequence.intrinsics


def test_labels_without_their_cloud(tmp_path: Path) -> None:
    (tmp_path / "frame-000000.pose.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    (tmp_path / "camera-intrinsics.txt").write_text("60 0 31.5\n0 60 23.5\n0 0 1\n")
    write_png(tmp_path / "frame-000000.color.png", np.zeros((48, 64, 3), np.uint8))
    write_png(tmp_path / "frame-000000.depth.png", np.full((48, 64), 1000, np.uint16))
    (tmp_path / "labels.json").write_text(
        json.dumps({"R_aligned_world": np.eye(3).tolist(), "plane_offset": 0.0, "objects": []})
    )
    with pytest.raises(SourceError, match=r"labelled_cloud\.npz"):
        open_dataset(str(tmp_path), Settings())


def test_what_a_scene_hardly_shows_is_not_judged() -> None:
    truth = open_dataset("scene:2", Settings(), frames=30).sequences[0].truth
    assert truth is not None
    assert set(np.unique(truth.label).tolist()) == {0, IGNORED, *truth.labels}
