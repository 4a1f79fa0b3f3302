"""Loaders of 7-Scenes and TUM folders, on tiny folders made here."""

import json
import os
import struct
import zlib
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.source.calibration import SEVEN_SCENES_COLOUR
from spot3d.source.errors import SourceError
from spot3d.source.halving import halve
from spot3d.source.recording import Recording
from spot3d.source.sequences import open_source
from spot3d.trajectory import rotation_from_vector

WIDTH, HEIGHT = 24, 16
INTRINSICS = "20 0 12\n0 20 8\n0 0 1\n"
POSE = np.eye(4) + np.array([[0, 0, 0, 0.5], [0, 0, 0, -1], [0, 0, 0, 2], [0, 0, 0, 0]])
DATA = Path(os.environ.get("SPOT3D_DATA", Path(__file__).parents[2] / "../shared/data"))


def depth_image() -> np.ndarray:
    depth = np.full((HEIGHT, WIDTH), 1500, np.uint16)
    depth[0, 0], depth[0, 1] = 0, 65535
    return depth


def colour_image(height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    image = np.zeros((height, width, 3), np.uint8)
    image[...] = (200, 100, 50)
    return image


def write(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True, parents=True)
    assert cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image)


@pytest.fixture
def seven_scenes(tmp_path: Path) -> Path:
    for number in (0, 1, 3):
        write(tmp_path / f"frame-{number:06d}.color.png", colour_image())
        write(tmp_path / f"frame-{number:06d}.depth.png", depth_image())
        np.savetxt(tmp_path / f"frame-{number:06d}.pose.txt", POSE)
    (tmp_path / "camera-intrinsics.txt").write_text(INTRINSICS)
    return tmp_path


@pytest.fixture
def tum(tmp_path: Path) -> Path:
    folder = tmp_path / "rgbd_dataset_freiburg2_desk"
    for name in ("1.000000", "1.100000", "1.200000"):
        write(folder / "rgb" / f"{name}.png", colour_image(600, 700))
        write(folder / "depth" / f"{name}.png", np.full((600, 700), 10000, np.uint16))
    (folder / "rgb.txt").write_text(
        "# timestamp filename\n1.010000 rgb/1.000000.png\n1.130000 rgb/1.100000.png\n1.2 rgb/1.200000.png\n"
    )
    (folder / "depth.txt").write_text(
        "1.000000 depth/1.000000.png\n1.100000 depth/1.100000.png\n1.200001 depth/1.200000.png\n"
    )
    (folder / "groundtruth.txt").write_text(
        "# timestamp tx ty tz qx qy qz qw\n0.99 1 2 3 0 0 0.70710678 0.70710678\n1.5 0 0 0 0 0 0 1\n"
    )
    return folder


def test_seven_scenes_frames(seven_scenes: Path) -> None:
    sequence = open_source(seven_scenes)
    assert len(sequence) == len(list(sequence)) == 3
    assert sequence.stamps_ns == [0, 33_333_333, 100_000_000]
    assert sequence.has_true_poses
    frame = sequence[2]
    assert frame.stamp_ns == 100_000_000
    assert (frame.colour == (200, 100, 50)).all()
    assert frame.depth_metres()[5, 5] == pytest.approx(1.5)
    assert frame.depth[0, 0] == 0
    assert frame.depth[0, 1] == 0, "65535 means nothing measured"
    np.testing.assert_array_equal(frame.T_world_camera, POSE)
    assert (frame.intrinsics.fx, frame.intrinsics.cx, frame.intrinsics.width) == (20, 12, WIDTH)


def test_seven_scenes_without_poses(seven_scenes: Path) -> None:
    for path in seven_scenes.glob("*.pose.txt"):
        path.unlink()
    assert not open_source(seven_scenes).has_true_poses


@pytest.mark.parametrize("ending", ["jpg", "jpeg", "PNG", "JPG", "JPEG"])
def test_colour_of_seven_scenes_ends_as_cameras_write_it(seven_scenes: Path, ending: str) -> None:
    for path in seven_scenes.glob("*.color.png"):
        path.rename(path.with_suffix(f".{ending}"))
    assert (open_source(seven_scenes)[2].colour == (200, 100, 50)).all()


def test_a_lost_pose_is_no_pose(seven_scenes: Path) -> None:
    np.savetxt(seven_scenes / "frame-000001.pose.txt", np.full((4, 4), -np.inf))
    sequence = open_source(seven_scenes)
    assert sequence.true_pose(1) is None
    assert sequence.true_pose(0) is not None


def test_a_rotation_that_was_rounded_is_made_exact(seven_scenes: Path) -> None:
    pose = POSE.copy()
    pose[:3, :3] = rotation_from_vector(np.array([1.3, 0.1, 1.5]))
    rounded = np.round(pose, 3)
    np.savetxt(seven_scenes / "frame-000001.pose.txt", rounded, fmt="%.3f")
    assert np.abs(rounded[:3, :3] @ rounded[:3, :3].T - np.eye(3)).max() > 1e-3, "no message takes it"
    frame = open_source(seven_scenes)[1]
    assert frame.T_world_camera is not None
    rotation = frame.T_world_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(frame.T_world_camera, pose, atol=1e-3)


def test_halved_depth_is_never_averaged(seven_scenes: Path) -> None:
    depth = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH) + 1000
    write(seven_scenes / "frame-000000.depth.png", depth)
    frame = open_source(seven_scenes, halved=True)[0]
    np.testing.assert_array_equal(frame.depth, depth[::2, ::2])
    assert frame.colour.shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert (frame.intrinsics.fx, frame.intrinsics.cx) == (10, 6)


def test_intrinsics_option_overrides_the_file(seven_scenes: Path) -> None:
    (seven_scenes / "camera-intrinsics.txt").unlink()
    assert open_source(seven_scenes, intrinsics=(30, 31, 11, 7)).intrinsics.fy == 31


def test_calibration_file_decides_on_registration(seven_scenes: Path) -> None:
    sequence = open_source(seven_scenes)
    assert isinstance(sequence, Recording)
    assert sequence.registration is None, "unknown cameras are taken as registered"
    camera = {"fx": 20, "fy": 20, "cx": 12, "cy": 8, "width": WIDTH, "height": HEIGHT}
    (seven_scenes / "calibration.json").write_text(json.dumps({"colour": camera, "T_colour_depth": np.eye(4).tolist()}))
    sequence = open_source(seven_scenes)
    assert isinstance(sequence, Recording)
    assert sequence.registration is not None
    assert (sequence[0].colour == (200, 100, 50)).all()


def test_kinect_of_seven_scenes_is_known(tmp_path: Path) -> None:
    write(tmp_path / "frame-000000.color.jpg", colour_image(480, 640))
    write(tmp_path / "frame-000000.depth.png", np.full((480, 640), 1000, np.uint16))
    sequence = open_source(tmp_path, intrinsics=(585, 585, 320, 240))
    assert isinstance(sequence, Recording)
    assert sequence.registration is not None
    assert sequence.registration.camera is SEVEN_SCENES_COLOUR


def test_tum_association(tum: Path) -> None:
    sequence = open_source(tum)
    assert sequence.stamps_ns == [1_000_000_000, 1_200_001_000], "colour 30 ms off is no match"
    assert sequence.intrinsics.fx == 520.9, "published for freiburg2"
    frame = sequence[0]
    assert frame.depth_metres()[0, 0] == pytest.approx(2.0)
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(frame.T_world_camera, expected, atol=1e-7)
    assert sequence[1].T_world_camera is None
    assert sequence.has_true_poses


def test_tum_poses_are_those_of_the_depth_images_times(tum: Path) -> None:
    (tum / "groundtruth.txt").write_text("0.9 1 2 3 0 0 0 1\n1.05 4 5 6 0 0 0 1\n1.22 7 8 9 0 0 0 1\n")
    poses = [frame.T_world_camera for frame in open_source(tum)]
    assert all(pose is not None for pose in poses)
    np.testing.assert_allclose(poses[0][:3, 3], (3, 4, 5), atol=1e-6)
    np.testing.assert_allclose(poses[1][:3, 3], np.array((4, 5, 6)) + 3 * 0.150001 / 0.17, atol=1e-6)


def test_a_tum_pose_near_an_end_or_a_gap_is_the_nearest(tum: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tum / "groundtruth.txt").write_text("0.985 1 2 3 0 0 0 1\n1.5 7 8 9 0 0 0 1\n")
    poses = [frame.T_world_camera for frame in open_source(tum)]
    assert poses[0] is not None
    np.testing.assert_array_equal(poses[0][:3, 3], (1, 2, 3))
    assert poses[1] is None, "the gap of half a second is too long"
    assert "2 of 3 depth images have no pose at their time" in caplog.text


def test_tum_intrinsics_file_comes_first(tum: Path) -> None:
    (tum / "intrinsics.txt").write_text("# fx fy cx cy\n500 501 300 200\n")
    assert open_source(tum).intrinsics.fy == 501


def _replace(name: str, content: str | bytes | np.ndarray | None) -> Callable[..., None]:
    def change(folder: Path, stem: str = "") -> None:
        path = folder / name.format(stem)
        if content is None:
            path.unlink()
        elif isinstance(content, str):
            path.write_text(content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            write(path, content)

    return change


def bomb() -> bytes:
    """A PNG of 100 bytes that says it is 200,000 x 200,000 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    size = struct.pack(">IIBBBBB", 200_000, 200_000, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")


def _calibration(x: float) -> str:
    T_colour_depth = np.eye(4)
    T_colour_depth[0, 3] = x
    camera = {"fx": 20, "fy": 20, "cx": 12, "cy": 8, "width": WIDTH, "height": HEIGHT}
    return json.dumps({"colour": camera, "T_colour_depth": T_colour_depth.tolist()})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_replace("frame-000000.depth.png", ""), "is empty"),
        (_replace("frame-000000.depth.png", "no image"), "not a readable image"),
        (_replace("frame-000000.color.png", "no image"), "not a readable image"),
        (_replace("frame-000000.color.png", None), "frame-000000.color.png is missing"),
        (_replace("frame-000000.depth.png", np.zeros((HEIGHT, WIDTH), np.uint8)), "8-bit depth"),
        (_replace("frame-000000.depth.png", np.zeros((HEIGHT, WIDTH, 3), np.uint16)), "16-bit PNG with one channel"),
        (_replace("frame-000001.depth.png", np.zeros((HEIGHT, 9), np.uint16)), "size mismatch.*9x16"),
        (_replace("frame-000001.color.png", colour_image(8, 12)), "size mismatch.*12x8"),
        (_replace("camera-intrinsics.txt", None), "no intrinsics.*--intrinsics"),
        (_replace("camera-intrinsics.txt", "1 2 3"), "3 numbers; expected fx fy cx cy, or"),
        (_replace("camera-intrinsics.txt", "20 0 12 0 20 8 0 0 7"), "malformed"),
        (_replace("camera-intrinsics.txt", "20 0 320 0 20 240 0 0 1"), "intrinsics of images of this size"),
        (_replace("camera-intrinsics.txt", "-20 0 12 0 20 8 0 0 1"), "positive"),
        (_replace("calibration.json", "{"), "calibration.json is malformed"),
        (_replace("calibration.json", "[" * 100_000), "calibration.json is malformed"),
        (_replace("calibration.json", "[]"), "calibration.json is malformed: the document: Input should be"),
        (_replace("calibration.json", _calibration(25.0)), "cameras 25 m apart; give the translation in metres"),
        (_replace("calibration.json", _calibration(0.1).replace("[[1.0", "[[-1.0")), "not a rigid transform"),
        (_replace("calibration.json", _calibration(0.1).replace("1.0]]", "2.0]]")), "not a rigid transform"),
        (
            _replace("calibration.json", _calibration(0.1).replace('"cx": 12', '"cx": 99')),
            "intrinsics of images of this size",
        ),
        (_replace("calibration.json", _calibration(0.1).replace('"fx": 20', '"fx": 1e300')), "of 1e.300 and 20 pixels"),
        (
            _replace("camera-intrinsics.txt", "0.02 0 12 0 0.02 8 0 0 1"),
            "of 0.02 and 0.02 pixels .*; give them in pixels",
        ),
        (_replace("camera-intrinsics.txt", "20 3 12 0 20 8 0 0 1"), "malformed: expected"),
        (_replace("frame-000001.depth.png", bomb()), "not a readable image"),
        (_replace("frame-000001.color.png", bomb()), "not a readable image"),
        (_replace("calibration.json", "{}"), "give .registered"),
        (_replace("calibration.json", '{"colour": {"fx": "wide"}}'), "colour.fx"),
        (_replace("calibration.json", '{"K": [20]}'), "K: Extra inputs are not permitted; expected"),
        (_replace("calibration.json", _calibration(float("nan"))), "not a rigid transform"),
    ],
)
def test_seven_scenes_errors(seven_scenes: Path, change: Callable[[Path], None], message: str) -> None:
    change(seven_scenes)
    with pytest.raises(SourceError, match=message):
        list(open_source(seven_scenes))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_replace("rgb.txt", None), "rgb.txt is missing"),
        (
            _replace("rgb.txt", "noon rgb/1.000000.png\n"),
            "rgb.txt:1 .*must begin with a timestamp in seconds, not with 'noon'$",
        ),
        (
            _replace("depth.txt", "1341841278000000000 depth/1.000000.png\n"),
            r"depth.txt:1 .*must begin with a timestamp in seconds.*; is it in another unit, such as nanoseconds\?$",
        ),
        (_replace("depth.txt", "1.0\n"), "nothing follows"),
        (_replace("rgb.txt", "7.0 rgb/1.000000.png\n"), "within 20 ms"),
        (_replace("rgb.txt", "1.0 rgb/none.png\n"), "none.png is missing"),
        (_replace("groundtruth.txt", "1.0 0 0 0 0 0 0\n"), "groundtruth.txt:1 .*expected"),
        (_replace("groundtruth.txt", "1.0 0 0 0 0 0 0 2\n"), "length is 2.000"),
        (
            _replace("groundtruth.txt", "1.0 0 0 0 0 0 0 w\n"),
            "groundtruth.txt:1 .*'w' is not a finite number; expected",
        ),
        (
            _replace("groundtruth.txt", "1.0 0 0 nan 0 0 0 1\n"),
            "groundtruth.txt:1 .*'nan' is not a finite number; expected",
        ),
        (
            _replace("groundtruth.txt", "nan 0 0 0 0 0 0 1\n"),
            "groundtruth.txt:1 .*timestamp in seconds, not with 'nan'",
        ),
        (_replace("intrinsics.txt", "1 2 3\n"), "3 numbers; expected fx fy cx cy, or"),
        (_replace("depth.txt", "1.0 depth/nu\0ll.png\n"), "cannot be read: embedded null byte"),
        (_replace("depth.txt", f"1.0 depth/{'x' * 5000}.png\n"), "cannot be read: File name too long"),
        (_replace("depth.txt", "# nothing\n"), "depth.txt lists no images"),
        (_replace("rgb.txt", ""), "rgb.txt lists no images"),
    ],
)
def test_tum_errors(tum: Path, change: Callable[[Path], None], message: str) -> None:
    change(tum)
    with pytest.raises(SourceError, match=message):
        list(open_source(tum))


def test_a_recording_whose_images_all_have_another_size_is_refused_at_once(seven_scenes: Path) -> None:
    for path in seven_scenes.glob("*.color.png"):
        write(path, colour_image(HEIGHT // 2, WIDTH // 2))
    with pytest.raises(SourceError, match=r"none of 3 frames .* size mismatch"):
        open_source(seven_scenes)


def test_frames_that_are_numbered_by_time_are_refused_at_once(seven_scenes: Path) -> None:
    for kind in ("color", "depth"):
        stem = seven_scenes / "frame-1341841278842700"
        (seven_scenes / f"frame-000003.{kind}.png").rename(f"{stem}.{kind}.png")
    with pytest.raises(SourceError, match=r"frame-1341841278842700\.depth\.png: .* number the frames from 0"):
        open_source(seven_scenes)


BROKEN = [
    _replace("{}.depth.png", ""),
    _replace("{}.depth.png", "no image"),
    _replace("{}.depth.png", np.zeros((HEIGHT, WIDTH), np.uint8)),
    _replace("{}.depth.png", np.zeros((HEIGHT, WIDTH, 3), np.uint16)),
    _replace("{}.color.png", None),
    _replace("{}.color.png", "no image"),
]


@pytest.mark.parametrize("change", BROKEN)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_broken_image_is_that_of_one_frame_whichever_its_place(
    seven_scenes: Path, change: Callable[[Path, str], None], place: int
) -> None:
    change(seven_scenes, f"frame-{(0, 1, 3)[place]:06d}")
    sequence = open_source(seven_scenes)
    assert sequence.intrinsics.shape == (HEIGHT, WIDTH)
    for index in range(3):
        with pytest.raises(SourceError) if index == place else nullcontext():
            assert sequence[index].depth.shape == (HEIGHT, WIDTH)


@pytest.mark.parametrize("change", BROKEN)
def test_a_folder_without_any_frame_that_can_be_read_is_refused(
    seven_scenes: Path, change: Callable[[Path, str], None]
) -> None:
    for number in (0, 1, 3):
        change(seven_scenes, f"frame-{number:06d}")
    with pytest.raises(SourceError, match=r"none of 3 frames has readable .*; the first error: .*frame-000000\."):
        open_source(seven_scenes)


def test_colour_without_depth_is_told(seven_scenes: Path, caplog: pytest.LogCaptureFixture) -> None:
    (seven_scenes / "frame-000001.depth.png").unlink()
    assert open_source(seven_scenes).stamps_ns == [0, 100_000_000]
    assert f"{seven_scenes}: 1 of 3 colour images are left out, as they have no depth image" in caplog.text


def test_a_broken_first_image_of_tum_is_that_of_one_frame(tum: Path) -> None:
    (tum / "depth/1.000000.png").write_bytes(b"")
    sequence = open_source(tum)
    assert len(sequence) == 2
    with pytest.raises(SourceError, match="is empty"):
        sequence[0]
    assert sequence[1].depth.shape == (600, 700)


MALFORMED_POSES = ["not a pose", "1 0 0 0", "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1", ""]


@pytest.mark.parametrize("text", MALFORMED_POSES)
def test_a_malformed_pose_is_no_pose_and_told(seven_scenes: Path, text: str, caplog: pytest.LogCaptureFixture) -> None:
    (seven_scenes / "frame-000000.pose.txt").write_text(text)
    sequence = open_source(seven_scenes)
    assert [sequence.true_pose(index) is None for index in range(3)] == [True, False, False]
    assert (
        f"1 of 3 poses of {seven_scenes} are left out; the first: {seven_scenes}/frame-000000.pose.txt" in caplog.text
    )
    for number in (1, 3):
        (seven_scenes / f"frame-{number:06d}.pose.txt").write_text(text)
    with pytest.raises(SourceError, match=r"frame-000000\.pose\.txt is malformed"):
        open_source(seven_scenes)


@pytest.mark.parametrize(
    "line",
    [
        "1.0 0 0 0 0 0 0",
        "1.0 0 0 0 0 0 0 2",
        "1.0 nan nan nan nan nan nan nan",
        "nan 0 0 0 0 0 0 1",
        "1e30 0 0 0 0 0 0 1",
        "1.0",
    ],
)
def test_a_malformed_line_of_poses_is_left_out_and_told(tum: Path, line: str, caplog: pytest.LogCaptureFixture) -> None:
    good = "1.005 1 2 3 0 0 0 1\n1.2 4 5 6 0 0 0 1\n"
    (tum / "groundtruth.txt").write_text(f"{line}\n{good}")
    sequence = open_source(tum)
    found = [sequence.true_pose(index) for index in range(2)]
    assert [None if pose is None else pose[0, 3] for pose in found] == [1, 4]
    assert f"1 of 3 lines of {tum}/groundtruth.txt are left out; the first: {tum}/groundtruth.txt:1 is" in caplog.text


def test_a_malformed_line_of_images_is_left_out_and_told(tum: Path, caplog: pytest.LogCaptureFixture) -> None:
    lines = (tum / "depth.txt").read_text()
    (tum / "depth.txt").write_text(f"noon depth/0.9.png\n{lines}")
    assert open_source(tum).stamps_ns == [1_000_000_000, 1_200_001_000]
    assert "1 of 4 lines of" in caplog.text
    assert "1 of 3 depth images are left out, as they have no colour image within 20 ms" in caplog.text


def test_intrinsics_of_half_the_size_are_told(seven_scenes: Path, caplog: pytest.LogCaptureFixture) -> None:
    (seven_scenes / "camera-intrinsics.txt").write_text("10 0 6\n0 10 4\n0 0 1\n")
    open_source(seven_scenes)
    assert "the principal point (6, 4) is far from the centre of the 24x16 image" in caplog.text


def test_lists_of_images_may_have_a_byte_order_mark_and_spaces_in_names(tum: Path) -> None:
    (tum / "depth").rename(tum / "tiefe \u2014 1")
    lines = (tum / "depth.txt").read_text().replace("depth/", "tiefe \u2014 1/")
    (tum / "depth.txt").write_text(lines, encoding="utf-8-sig")
    assert [len(frame.depth) for frame in open_source(tum)] == [600, 600]


def test_tum_unknown_camera(tum: Path) -> None:
    renamed = tum.rename(tum.parent / "my_desk")
    with pytest.raises(SourceError, match="does not contain a TUM camera"):
        open_source(renamed)


def test_folder_errors(seven_scenes: Path, tmp_path: Path) -> None:
    for path, message in (
        (tmp_path / "nowhere", "does not exist"),
        (seven_scenes / "camera-intrinsics.txt", "is a file"),
    ):
        with pytest.raises(SourceError, match=message):
            open_source(path)
    inner = tmp_path / "outer" / "seq-01"
    inner.mkdir(parents=True)
    with pytest.raises(SourceError, match=r"is not a recording: .* Depth images in a folder must be 16-bit PNG$"):
        open_source(inner)
    write(inner / "frame-000000.depth.png", depth_image())
    with pytest.raises(SourceError, match="seq-01"):
        open_source(inner.parent)


@pytest.mark.parametrize(("folder", "frames", "focal"), [("redkitchen", 1000, 585.0), ("tum_fr3_cabinet", 58, 535.4)])
def test_developer_data(folder: str, frames: int, focal: float) -> None:
    if not (DATA / folder).is_dir():
        pytest.skip(f"{DATA / folder} is not there (SPOT3D_DATA names the folder)")
    sequence = open_source(DATA / folder)
    assert len(sequence) == frames
    assert sequence.intrinsics.fx == focal
    assert sequence.has_true_poses
    frame = sequence[frames // 2]
    assert 0.5 < np.median(frame.depth_metres()[frame.depth > 0]) < 5


def test_colour_of_a_halved_recording_lies_where_it_lay_at_full_size(seven_scenes: Path) -> None:
    rng = np.random.default_rng(3)
    colour = cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT + 5, WIDTH + 7, 3)).astype(np.uint8), (0, 0), 2.5)
    T_colour_depth = np.eye(4)
    T_colour_depth[0, 3] = -0.1
    camera = {"fx": 24, "fy": 24, "cx": 15, "cy": 10, "width": WIDTH + 7, "height": HEIGHT + 5}
    calibration = {"colour": camera, "T_colour_depth": T_colour_depth.tolist()}
    (seven_scenes / "calibration.json").write_text(json.dumps(calibration))
    write(seven_scenes / "frame-000000.color.png", colour)
    full, half = open_source(seven_scenes)[0], open_source(seven_scenes, halved=True)[0]
    expected = halve(full)
    assert half.intrinsics == expected.intrinsics
    np.testing.assert_array_equal(half.depth, expected.depth)
    # Both smooth a little, each in its own way; a quarter of a pixel off would make a quarter of the step.
    inner = (slice(1, -1), slice(1, -1))
    difference = np.abs(half.colour.astype(int) - expected.colour)[inner]
    step = np.abs(full.colour[::2, 2::2].astype(int) - full.colour[::2, :-2:2])[:-2, 1:]
    assert difference.mean() < 0.1 * step.mean()


def test_images_of_a_halved_recording_must_have_their_full_size(seven_scenes: Path) -> None:
    write(seven_scenes / "frame-000001.color.png", colour_image(HEIGHT // 2, WIDTH // 2))
    with pytest.raises(SourceError, match=r"size mismatch: .*frame-000001\.color\.png is 12x8"):
        open_source(seven_scenes, halved=True)[1]


@pytest.mark.parametrize("halved", [False, True])
def test_the_unit_of_depth_can_be_told(tum: Path, halved: bool) -> None:
    assert open_source(tum, halved=halved)[0].depth_metres()[5, 5] == pytest.approx(2.0)
    assert open_source(tum, halved=halved, depth_unit=0.001)[0].depth_metres()[5, 5] == pytest.approx(10.0)


def test_what_tells_its_unit_itself_takes_no_other() -> None:
    with pytest.raises(SourceError, match="scene states its own unit of depth; omit --depth-unit"):
        open_source("scene", 2, depth_unit=0.001)
