"""Truth files and a run's objects: made-up samples, broken ones, and the real data where it is."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.evaluate.points import points_in_boxes
from spot3d.evaluate.truth import read_cuboids, read_found_boxes, read_labelled_scene
from spot3d.source.errors import SourceError

DATA = Path(os.environ.get("SPOT3D_DATA", Path(__file__).parents[2] / "../shared/data"))

# The world's y axis points down and the plane lies at y = 2: aligned = (x, z, -y), whose z is -2 there.
R_ALIGNED_WORLD = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
MUG = {"centre": [0.5, 1.0, 0.05], "size": [0.4, 0.2, 0.1], "yaw_rad": np.pi / 6}


def write_scene(folder: Path, **changes: Any) -> None:
    labels: dict[str, Any] = {
        "R_aligned_world": R_ALIGNED_WORLD,
        "plane_offset": -2.0,
        "objects": [{"name": "mug", "label": 1, "min_area_box": MUG}],
    }
    (folder / "labels.json").write_text(json.dumps(labels | changes))
    # The mug's box seen from its long side's end: 0.15 m from the centre along an axis turned by 30 degrees.
    along = 0.15 * np.array([np.cos(np.pi / 6), 0, np.sin(np.pi / 6)])
    xyz = np.array([[0.5, 1.95, 1.0], np.array([0.5, 1.95, 1.0]) + along, [3, 2, 1]], dtype=np.float32)
    np.savez(folder / "labelled_cloud.npz", xyz_world=xyz, label=np.array([1, 1, 0], dtype=np.uint8))


def test_labelled_scene(tmp_path: Path) -> None:
    write_scene(tmp_path)
    scene = read_labelled_scene(tmp_path)
    assert (scene.names, scene.labels) == (("mug",), (1,))
    np.testing.assert_allclose(scene.up, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(scene.boxes[0].centre, [0.5, 1.95, 1.0], atol=1e-12)
    np.testing.assert_allclose(scene.boxes[0].size, [0.4, 0.2, 0.1])
    np.testing.assert_allclose(scene.boxes[0].rotation[:, 2], scene.up, atol=1e-12)
    assert scene.xyz.dtype == np.float32
    assert scene.label.dtype == np.uint8
    assert points_in_boxes(scene.xyz, scene.boxes).tolist() == [True, True, False]


def test_labelled_scene_without_objects(tmp_path: Path) -> None:
    write_scene(tmp_path, objects=[])
    scene = read_labelled_scene(tmp_path)
    assert (scene.names, scene.boxes) == ((), ())


@pytest.mark.parametrize("missing", ["labels.json", "labelled_cloud.npz"])
def test_labelled_scene_names_the_missing_file(tmp_path: Path, missing: str) -> None:
    write_scene(tmp_path)
    (tmp_path / missing).unlink()
    with pytest.raises(FileNotFoundError, match=missing):
        read_labelled_scene(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plane_offset": None}, "plane_offset"),
        ({"plane_offset": float("nan")}, "plane_offset"),
        ({"R_aligned_world": [[1, 0], [0, 1]]}, "R_aligned_world"),
        ({"R_aligned_world": [[1, 0, 0], [0, 0, 1], [0, 1, 0]]}, "mug: box rotation"),
        ({"objects": [{"name": "mug", "label": 1}]}, r"objects\.0\.min_area_box"),
        (
            {"objects": [{"name": "mug", "label": 1, "min_area_box": MUG | {"size": [1, 1, -1]}}]},
            "mug: box size",
        ),
        (
            {"objects": [{"name": "mug", "label": 1, "min_area_box": MUG | {"size": [400, 200, 100]}}]},
            "mug: a side of 400 m is implausibly long; give boxes in metres",
        ),
        (
            {"objects": [{"name": "mug", "label": 1, "min_area_box": MUG | {"centre": [500, 1000, 50]}}]},
            "mug: its box contains none of its 2 points in labelled_cloud.npz",
        ),
        ({"objects": [{"name": "mug", "label": 0, "min_area_box": MUG}]}, r"objects\.0\.label: .* equal to 1"),
        ({"objects": [{"name": "mug", "label": 255, "min_area_box": MUG}]}, r"objects\.0\.label: .* equal to 254"),
        (
            {"objects": [{"name": name, "label": 7, "min_area_box": MUG} for name in ("mug", "cup")]},
            "objects: .*mug and cup have the same label, 7",
        ),
    ],
)
def test_broken_labels_name_the_field(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    write_scene(tmp_path, **changes)
    with pytest.raises(ValueError, match=rf"labels\.json.*{message}"):
        read_labelled_scene(tmp_path)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "xyz_world"),
        ({"xyz_world": np.zeros((3, 3))}, "label"),
        ({"xyz_world": np.zeros((3, 2)), "label": np.zeros(3, np.uint8)}, "xyz_world must be floats"),
        ({"xyz_world": np.zeros((3, 3)), "label": np.zeros(2, np.uint8)}, "label must be uint8"),
        ({"xyz_world": np.zeros((3, 3)), "label": np.full(3, 300)}, "label must be uint8"),
    ],
)
def test_broken_cloud_names_the_array(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    write_scene(tmp_path)
    np.savez(tmp_path / "labelled_cloud.npz", **arrays)
    with pytest.raises(ValueError, match=rf"labelled_cloud\.npz.*{message}"):
        read_labelled_scene(tmp_path)


@pytest.mark.parametrize("content", [b"", b"no archive"])
def test_a_cloud_that_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    write_scene(tmp_path)
    (tmp_path / "labelled_cloud.npz").write_bytes(content)
    with pytest.raises(ValueError, match="expected an archive"):
        read_labelled_scene(tmp_path)


@pytest.mark.parametrize(("text", "count"), [("", 0), ("# x y z yaw\n\n", 0), ("1 2 3 0 1 1 1\n" * 2, 2)])
def test_cuboids_count(tmp_path: Path, text: str, count: int) -> None:
    (tmp_path / "truth.txt").write_text(text)
    assert len(read_cuboids(tmp_path / "truth.txt")) == count


def test_cuboids_may_begin_with_a_byte_order_mark_and_must_be_utf8(tmp_path: Path) -> None:
    path = tmp_path / "truth.txt"
    path.write_text("1 2 3 0 1 1 1\r\n", encoding="utf-8-sig")
    assert len(read_cuboids(path)) == 1
    path.write_text("# K\u00fcche\n1 2 3 0 1 1 1\n", encoding="latin-1")
    with pytest.raises(SourceError, match=r"truth\.txt is not a text file in UTF-8: .*; save it as UTF-8$"):
        read_cuboids(path)


def test_labels_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    write_scene(tmp_path)
    written = (tmp_path / "labels.json").read_text()
    (tmp_path / "labels.json").write_text(written, encoding="utf-8-sig")
    assert read_labelled_scene(tmp_path).names


def test_cuboid_has_half_sizes_and_a_yaw_about_z(tmp_path: Path) -> None:
    (tmp_path / "truth.txt").write_text(f"1 2 3 {np.pi / 6} 0.5 0.25 0.1  # a cabinet\n")
    (cuboid,) = read_cuboids(tmp_path / "truth.txt")
    np.testing.assert_allclose(cuboid.centre, [1, 2, 3])
    np.testing.assert_allclose(cuboid.size, [1, 0.5, 0.2])
    np.testing.assert_allclose(cuboid.rotation[:, 0], [np.cos(np.pi / 6), 0.5, 0])
    np.testing.assert_allclose(cuboid.rotation[:, 2], [0, 0, 1])


@pytest.mark.parametrize(
    "line",
    [
        "1 2 3",
        "1 2 3 0 1 1",
        "1 2 3 0 1 1 1 1",
        "1 2 3 0 1 1 x",
        "1 2 3 0 1 1 -1",
        "nan 2 3 0 1 1 1",
        "9 9 9 0 70 30 90",
    ],
)
def test_a_broken_cuboid_names_its_line(tmp_path: Path, line: str) -> None:
    (tmp_path / "truth.txt").write_text(f"# comment\n{line}\n")
    with pytest.raises(ValueError, match=r"truth\.txt, line 2"):
        read_cuboids(tmp_path / "truth.txt")


def test_cuboids_name_the_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"truth\.txt"):
        read_cuboids(tmp_path / "truth.txt")


FOUND = {
    "id": 7,
    "centre": [1, 2, 3],
    "size": [0.3, 0.2, 0.1],
    "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "points": 321,
    "confidence": 0.5,
    "views": 12,
}


def write_objects(path: Path, *objects: dict[str, Any]) -> Path:
    path.write_text(json.dumps({"objects": objects, "up": [0, 0, 1], "frame_count": 3}))
    return path


def test_found_boxes(tmp_path: Path) -> None:
    assert read_found_boxes(write_objects(tmp_path / "none.json")) == ()
    (found,) = read_found_boxes(write_objects(tmp_path / "objects.json", FOUND))
    np.testing.assert_allclose(found.centre, [1, 2, 3])
    # Rows of the file are rows of the matrix: its first column, the box's long axis, is the world's y.
    np.testing.assert_allclose(found.rotation[:, 0], [0, 1, 0])
    same = Box3D(np.array([1, 2, 3]), np.array([0.2, 0.3, 0.1]), np.eye(3))
    np.testing.assert_allclose(iou_matrix_3d([found], [same]), [[1]], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"id": None}, r"objects\.0\.id"),
        ({"centre": [1, 2]}, r"objects\.0\.centre"),
        ({"size": [1, 2, -3]}, "object 7: box size"),
        ({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}, "object 7: box rotation"),
    ],
)
def test_broken_objects_name_the_field(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = write_objects(tmp_path / "objects.json", FOUND | change)
    with pytest.raises(ValueError, match=rf"objects\.json.*{message}"):
        read_found_boxes(path)


@pytest.mark.parametrize(("text", "message"), [("", "not valid JSON"), ("[]", "the document"), ("{}", "objects")])
def test_a_file_that_holds_no_objects_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "objects.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_found_boxes(tmp_path / "objects.json")


def test_the_boxes_of_redkitchen_hold_their_objects_points() -> None:
    folder = DATA / "redkitchen"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    scene = read_labelled_scene(folder)
    assert scene.names == ("mug", "cup", "plastic_box", "red_pouch")
    for label, box in zip(scene.labels, scene.boxes, strict=True):
        points = scene.xyz[scene.label == label]
        # The boxes are drawn by hand, good to 1 to 2 cm; a yaw of the wrong sign loses 8 % of the points.
        grown = Box3D(box.centre, box.size + 0.02, box.rotation)
        assert points_in_boxes(points, [box]).mean() > 0.88
        assert points_in_boxes(points, [grown]).mean() > 0.96


def test_the_cuboid_of_tum_fr3_cabinet() -> None:
    path = DATA / "tum_fr3_cabinet" / "truth_objects.txt"
    if not path.is_file():
        pytest.skip(f"no {path}")
    (cabinet,) = read_cuboids(path)
    bottom = cabinet.centre[2] - cabinet.size[2] / 2
    assert bottom == pytest.approx(0, abs=0.02)
