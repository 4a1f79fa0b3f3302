"""Opens an input by its path or name."""

import re
from pathlib import Path

from spot3d.recorder.profile import is_our_mcap
from spot3d.source.errors import SourceError
from spot3d.source.halving import Halved
from spot3d.source.intrinsics_files import FocalAndCentre
from spot3d.source.recording import Recording
from spot3d.source.sequence import FrameSequence
from spot3d.source.seven_scenes import is_seven_scenes, open_seven_scenes
from spot3d.source.tum import is_tum, open_tum

SCENE_NAME = re.compile(r"scene(?::(?P<seed>\d+))?(?P<cluttered>:cluttered)?")


def open_source(
    path_or_name: str | Path,
    frames: int = 300,
    intrinsics: FocalAndCentre | None = None,
    halved: bool = False,
) -> FrameSequence:
    """Opens a recording's folder by what it holds, or the built-in scene.

    `scene`, `scene:SEED`, `scene:SEED:cluttered` (or `scene:cluttered`) are the built-in scene with
    `frames` frames; a file is one that `spot3d record` has made; everything else is a folder in the layout of
    7-Scenes or TUM RGB-D. `intrinsics` (fx, fy, cx, cy) override a folder's; `halved` halves every frame.
    Raises SourceError, saying what is wrong and what to do.
    """
    sequence: FrameSequence
    if match := SCENE_NAME.fullmatch(str(path_or_name)):
        if intrinsics is not None:
            raise SourceError("the built-in scene has its own camera; leave --intrinsics away")
        from spot3d.source.scene.scene import Scene  # its kernels are slow to import

        sequence = Scene(int(match["seed"] or 0), match["cluttered"] is not None, frames)
    elif is_our_mcap(Path(path_or_name)):
        if intrinsics is not None:
            raise SourceError("a recording has its own intrinsics; leave --intrinsics away")
        from spot3d.source.mcap_sequence import open_recorded_mcap  # its packages are an extra's

        sequence = open_recorded_mcap(Path(path_or_name))
    else:
        sequence = _open_folder(Path(path_or_name), intrinsics)
    return at_half_size(sequence) if halved else sequence


def at_half_size(sequence: FrameSequence) -> FrameSequence:
    """The same frames at half size."""
    return sequence.halved() if isinstance(sequence, Recording) else Halved(sequence)


def _open_folder(folder: Path, intrinsics: FocalAndCentre | None) -> FrameSequence:
    if not folder.exists():
        raise SourceError(f"{folder} does not exist; give a recording's folder, or `scene` for the built-in scene")
    if not folder.is_dir():
        raise SourceError(f"{folder} is a file, and none that spot3d record has made; give a folder or such a file")
    if is_tum(folder):
        return open_tum(folder, intrinsics)
    if is_seven_scenes(folder):
        return open_seven_scenes(folder, intrinsics)
    inner = sorted(path.name for path in folder.iterdir() if path.is_dir())
    for name in inner:
        if is_tum(folder / name) or is_seven_scenes(folder / name):
            raise SourceError(f"{folder} holds recordings, but is none itself; open one, such as {folder / name}")
    raise SourceError(
        f"{folder} is no recording: neither frame-NNNNNN.depth.png (7-Scenes) nor depth.txt and rgb.txt (TUM RGB-D)"
    )
