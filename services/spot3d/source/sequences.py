"""Opens an input by its path or name."""

from dataclasses import replace
from pathlib import Path

from spot3d.recorder.profile import is_our_mcap
from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import FocalAndCentre
from spot3d.source.realsense.camera import is_camera, open_camera
from spot3d.source.realsense.recording import RealSenseRecording, is_realsense_recording
from spot3d.source.recording import Recording
from spot3d.source.ros.bag import is_ros_bag
from spot3d.source.ros.topics import TopicNames
from spot3d.source.scene.name import SPELLINGS, SPELLINGS_OF_MANY, parse_scene_name
from spot3d.source.sequence import FrameSequence, FrameStream
from spot3d.source.seven_scenes import is_seven_scenes, open_seven_scenes
from spot3d.source.tum import is_tum, open_tum

SCENE_FRAMES = 300
"""Default length of a built-in scene, frames at 30 Hz."""


def refuse_misnamed_scene(name: str) -> None:
    """Raises SourceError for a name that begins like a built-in scene's."""
    if name.startswith(("scene:", "scenes:")):
        raise SourceError(
            f"{name} is not a built-in scene; give {SPELLINGS}, or for spot3d evaluate {SPELLINGS_OF_MANY}"
        )


def open_source(
    path_or_name: str | Path,
    frames: int = SCENE_FRAMES,
    intrinsics: FocalAndCentre | None = None,
    halved: bool = False,
    topics: TopicNames | None = None,
    depth_unit: float = 0.0,
) -> FrameSequence:
    """Opens a recording by its content, or a built-in scene by its name.

    `scene`, `scene:SEED`, each with a kind (`:desk`; see `SceneKind`), are built-in scenes with `frames` frames. A file
    is a ROS bag, of which `topics` are played, or a recording of `spot3d record`. Everything else is a folder in the
    layout of 7-Scenes or TUM RGB-D. `intrinsics` (fx, fy, cx, cy) override the input's own. `depth_unit` (metres; 0:
    unchanged) overrides a folder's. `halved` halves every frame. Raises SourceError, saying what is wrong and what to
    do.
    """
    sequence: FrameSequence
    if (scene := parse_scene_name(str(path_or_name))) is not None:
        if intrinsics is not None:
            raise SourceError("the built-in scene has its own camera; omit --intrinsics")
        from spot3d.source.scene.scene import Scene  # numba takes a second to import

        sequence = Scene(scene.seed, scene.kind, frames)
    elif is_our_mcap(Path(path_or_name)):
        if intrinsics is not None:
            raise SourceError("a file of spot3d record states its own intrinsics; omit --intrinsics")
        from spot3d.source.mcap_sequence import McapSequence  # its packages are an extra's

        sequence = McapSequence(Path(path_or_name))
    else:
        sequence = _open_path(Path(path_or_name), intrinsics, topics or TopicNames())
    if depth_unit:
        if not isinstance(sequence, Recording):
            raise SourceError(f"{path_or_name} states its own unit of depth; omit --depth-unit")
        sequence = replace(sequence, depth_scale=depth_unit)
    return sequence.at_half_size() if halved else sequence


def is_stream(name: str) -> bool:
    """Whether an input is a camera, or a recording that plays like one: its frames come only once."""
    return is_camera(name) or is_realsense_recording(Path(name))


def has_topics(name: str) -> bool:
    """Whether an input is a ROS bag, whose topics can be named. Other files that end in .bag, .db3 or .mcap are not."""
    path = Path(name)
    return is_ros_bag(path) and not (is_our_mcap(path) or is_realsense_recording(path))


def open_stream(name: str) -> FrameStream:
    """The stream of a name for which `is_stream` holds. Raises SourceError if its SDK is not installed."""
    return open_camera(name) if is_camera(name) else RealSenseRecording(Path(name))


def _open_path(folder: Path, intrinsics: FocalAndCentre | None, topics: TopicNames) -> FrameSequence:
    if not folder.exists():
        refuse_misnamed_scene(str(folder))
        raise SourceError(f"{folder} does not exist; give a recording's folder, or `scene` for the built-in scene")
    if is_ros_bag(folder):
        from spot3d.source.ros.recording import open_bag

        return open_bag(folder, topics, intrinsics)
    if not folder.is_dir():
        raise SourceError(f"{folder} is a file, but not a ROS bag (.bag, .mcap, .db3); give a folder or a bag")
    if is_tum(folder):
        return open_tum(folder, intrinsics)
    if is_seven_scenes(folder):
        return open_seven_scenes(folder, intrinsics)
    for inner in sorted(folder.iterdir()):
        if is_ros_bag(inner) or is_tum(inner) or is_seven_scenes(inner):
            raise SourceError(f"{folder} contains recordings, but is not one itself; give one of them, such as {inner}")
    raise SourceError(
        f"{folder} is not a recording: it has neither frame-NNNNNN.depth.png (7-Scenes), nor depth.txt and rgb.txt "
        "(TUM RGB-D), nor metadata.yaml (ROS 2). Depth images in a folder must be 16-bit PNG"
    )
