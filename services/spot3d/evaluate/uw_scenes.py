"""RGB-D Scenes Dataset v2 of the University of Washington (Lai et al., ICRA 2014)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from spot3d.camera import Intrinsics, invert
from spot3d.evaluate.dominant_plane import dominant_plane
from spot3d.evaluate.labelled import LabelledSequence
from spot3d.evaluate.ply import read_ply_points
from spot3d.evaluate.points import BACKGROUND, IGNORED
from spot3d.evaluate.projection import measured_at
from spot3d.evaluate.truth import LabelledScene
from spot3d.geometry.upright import upright_box
from spot3d.source.errors import SourceError
from spot3d.source.images import read_depth
from spot3d.source.recording import RecordedFrame, Recording
from spot3d.trajectory import pose_from_quaternion

FOCAL, CENTRE = 570.3, (320.0, 240.0)
FRAME_NS = 33_333_333
THINGS = {1: "bowl", 2: "cap", 3: "cereal_box", 4: "coffee_mug", 6: "office_chair", 7: "soda_can"}
TABLES = (5, 9)
LABELS = range(1, 11)
UNITS_PER_METRE = (1000, 10_000)
VOXEL = 0.02
"""Points of a class in touching voxels of this size belong to one object, metres."""
PART = 0.1
"""A component with less than this share of the voxels of the class's largest one is a label's stray edge."""


def is_uw_scenes(folder: Path) -> bool:
    """Whether the folder has the data set's layout, complete or not."""
    return any((folder / "imgs").glob("scene_*")) or any((folder / "pc").glob("*.pose"))


def open_uw_scenes(folder: Path, every: int = 1, frames: int | None = None) -> tuple[LabelledSequence, ...]:
    """Every scene with its frames (every nth, at most `frames`), poses and labelled cloud.

    Layout: `imgs/scene_NN/NNNNN-{color,depth}.png`, `pc/NN.ply`, `pc/NN.label`, `pc/NN.pose`. By the data set's README,
    a pose is a quaternion, real part first, and the camera's position, one line a frame. The first number of `.label`
    is the number of points, then their labels follow: bowl 1, cap 2, cereal_box 3, coffee_mug 4, coffee_table 5,
    office_chair 6, soda_can 7, sofa 8 or 9, table 9, background 10. Objects are those of the paper's Sec. VI-B (tables,
    sofa and background are redundant points), split where they do not touch. Focal length and centre are those of
    depthToCloud.m. The README gives no unit of depth, so the cloud decides between the two in use. Raises SourceError
    for missing files.
    """
    scenes = sorted(path for path in (folder / "imgs").glob("scene_*") if path.is_dir())
    if not scenes:
        raise SourceError(f"{folder} is not a complete RGB-D Scenes v2: imgs/scene_NN is missing")
    return tuple(_open_scene(folder, scene, every, frames) for scene in scenes)


def _open_scene(folder: Path, scene: Path, every: int, frames: int | None) -> LabelledSequence:
    stem = folder / "pc" / scene.name.removeprefix("scene_")
    for suffix in (".ply", ".label", ".pose"):
        if not stem.with_suffix(suffix).is_file():
            raise SourceError(f"{stem.with_suffix(suffix)} is missing: it belongs to {scene}")
    poses = _read_poses(stem.with_suffix(".pose"))
    entries = [
        RecordedFrame(index * FRAME_NS, scene / f"{index:05d}-color.png", scene / f"{index:05d}-depth.png", pose)
        for index, pose in enumerate(poses)
    ]
    missing = next((path for entry in entries for path in (entry.colour, entry.depth) if not path.is_file()), None)
    if missing is not None:
        raise SourceError(f"{missing} is missing: {stem.with_suffix('.pose')} has a pose for it")
    xyz = read_ply_points(stem.with_suffix(".ply"))
    classes = _read_labels(stem.with_suffix(".label"), len(xyz))
    depth = read_depth(entries[0].depth)
    camera = Intrinsics(FOCAL, FOCAL, *CENTRE, depth.shape[1], depth.shape[0])
    units = depth_units(depth, camera, poses[0], xyz, entries[0].depth)
    recording = Recording(entries[::every][:frames], camera, 1 / units)
    return LabelledSequence(f"{folder.name}/{scene.name}", recording, scene_truth(xyz, classes, poses))


def scene_truth(xyz: NDArray[np.float32], classes: NDArray[np.int64], poses: NDArray[np.float64]) -> LabelledScene:
    """Objects of a labelled cloud: (n, 3) world points, their (n,) classes, (k, 4, 4) T_world_camera."""
    on_tables = np.isin(classes, TABLES)
    up = dominant_plane(xyz[on_tables] if on_tables.any() else xyz, poses[:, :3, 3].mean(axis=0))[:3]
    label = np.full(len(xyz), BACKGROUND, np.uint8)
    names, boxes = [], []
    for number, name in THINGS.items():
        rows = np.flatnonzero(classes == number)
        label[rows] = IGNORED
        for part in split_instances(xyz[rows]):
            names.append(name)
            label[rows[part]] = len(names)
            boxes.append(upright_box(xyz[rows[part]], up))
    return LabelledScene(tuple(names), tuple(range(1, len(names) + 1)), tuple(boxes), up, xyz, label)


def split_instances(xyz: NDArray[np.float32]) -> list[NDArray[np.int64]]:
    """Rows of each object among (n, 3) points of one class: connected components of voxels of 2 cm.

    Largest first. Small components are dropped.
    """
    if not len(xyz):
        return []
    voxel = np.floor((xyz - xyz.min(axis=0)) / VOXEL).astype(np.int64)
    filled = np.zeros(voxel.max(axis=0) + 1, np.bool_)
    filled[tuple(voxel.T)] = True
    number, count = ndimage.label(filled, structure=np.ones((3, 3, 3)))
    size = np.bincount(number[filled], minlength=count + 1)[1:]
    of_point = number[tuple(voxel.T)]
    kept = np.argsort(-size, kind="stable")
    return [np.flatnonzero(of_point == part + 1) for part in kept if size[part] >= PART * size.max()]


def depth_units(
    depth: NDArray[np.uint16],
    camera: Intrinsics,
    T_world_camera: NDArray[np.float64],
    xyz: NDArray[np.float32],
    path: Path,
) -> int:
    """Units of depth in a metre, 1000 or 10 000: whichever agrees with the cloud (n, 3) seen from this frame.

    Raises SourceError, naming `path`, if neither agrees within a fifth.
    """
    T = invert(T_world_camera).astype(np.float32)  # float32, as clouds are large
    expected, measured = measured_at(xyz @ T[:3, :3].T + T[:3, 3], depth, camera)
    ratio = float(np.median(measured[measured > 0] / expected[measured > 0])) if measured.any() else 0.0
    for units in UNITS_PER_METRE:
        if 0.8 < ratio / units < 1.25:
            return units
    raise SourceError(f"{path} and the scene's cloud do not agree: {ratio:.0f} units of depth to a metre of the cloud")


def _read_poses(path: Path) -> NDArray[np.float64]:
    poses = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            values = np.array([float(word) for word in line.split()])
            if values.shape != (7,) or not np.isfinite(values).all():
                raise ValueError("not seven finite numbers")
            poses.append(pose_from_quaternion(values[4:], values[[1, 2, 3, 0]]))
        except ValueError as error:
            raise SourceError(f"{path}:{number} is malformed: {error}; expected `a b c d x y z`") from error
    if not poses:
        raise SourceError(f"{path} contains no poses")
    return np.array(poses)


def _read_labels(path: Path, points: int) -> NDArray[np.int64]:
    try:
        numbers = np.array(path.read_text(encoding="ascii").split(), dtype=np.int64)
    except (UnicodeDecodeError, ValueError) as error:
        raise SourceError(f"{path} is malformed: it contains text that is not an integer") from error
    if not len(numbers) or numbers[0] != points or len(numbers) != points + 1:
        raise SourceError(f"{path} does not match its cloud of {points} points")
    unknown = set(np.unique(numbers[1:]).tolist()) - set(LABELS)
    if unknown:
        raise SourceError(f"{path}: unknown labels {sorted(unknown)}; known are 1 to 10")
    return numbers[1:]
