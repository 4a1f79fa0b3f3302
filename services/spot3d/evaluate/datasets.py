"""Opens a data set for evaluation by its path or name."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from spot3d.evaluate.labelled import DataSet, LabelledFrame, LabelledSequence
from spot3d.evaluate.osd import is_osd, open_osd
from spot3d.evaluate.rgbd_scenes import is_rgbd_scenes, open_rgbd_scenes
from spot3d.evaluate.scenes import open_scene
from spot3d.evaluate.truth import LabelledScene, read_cuboids, read_labelled_scene
from spot3d.evaluate.uw_scenes import is_uw_scenes, open_uw_scenes
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.source.halving import halve
from spot3d.source.intrinsics_files import FocalAndCentre
from spot3d.source.scene.name import scene_names
from spot3d.source.selected import Selection, open_selection
from spot3d.source.sequences import refuse_misnamed_scene
from spot3d.source.settings import SourceSettings
from spot3d.source.seven_scenes import is_seven_scenes
from spot3d.source.tum import is_tum

LAYOUTS = "7-Scenes, TUM RGB-D, OSD, RGB-D Scenes 2011 or RGB-D Scenes v2"
DEPTH = 2
"""Data sets are searched up to this many folders below a root."""


def open_dataset(
    name: str, settings: Settings, every: int = 1, frames: int | None = None, intrinsics: FocalAndCentre | None = None
) -> DataSet:
    """The data set in a folder, by its layout, or the built-in scene: `scene:SEED`, `scenes:COUNT` (seeds 0 ..).

    every: only each nth frame of a sequence; frames: at most this many of those. intrinsics: fx, fy, cx, cy in pixels
    for a folder in the layout of OSD, 7-Scenes or TUM RGB-D, instead of its own. Truth of 7-Scenes is `labels.json`
    with `labelled_cloud.npz`, that of TUM RGB-D `truth_objects.txt`. Without it, only poses are compared. At half size
    if the settings say so. Raises SourceError, saying what is missing.
    """
    source = settings.source.model_copy(update={"halved": False})
    opened = _opened(name, source, every, frames, intrinsics)
    return at_half_size(opened) if settings.source.halved else opened


def _opened(
    name: str, source: SourceSettings, every: int, frames: int | None, intrinsics: FocalAndCentre | None
) -> DataSet:
    scenes = scene_names(name)
    if scenes is not None:
        _has_own_camera(name, intrinsics)
        opened = [open_scene(scene, source, every, frames) for scene in scenes]
        return DataSet(name, tuple(read for _, reads in opened for read in reads), tuple(item for item, _ in opened))
    folder = Path(name)
    if not folder.is_dir():
        refuse_misnamed_scene(name)
        raise SourceError(f"{folder} is not a folder; give a data set's folder ({LAYOUTS}), scene or scenes:5")
    kind = dataset_kind(folder)
    if kind == "OSD":
        return DataSet(folder.name, open_osd(folder, every, frames, intrinsics))
    if kind == "RGB-D Scenes 2011":
        _has_own_camera(name, intrinsics)
        return DataSet(folder.name, open_rgbd_scenes(folder, every, frames))
    if kind == "RGB-D Scenes v2":
        _has_own_camera(name, intrinsics)
        return DataSet(folder.name, sequences=open_uw_scenes(folder, every, frames))
    if kind is None:
        raise SourceError(f"{folder} is not one of the data sets {LAYOUTS}; docs/measured.md describes their layouts")
    sequence = open_selection(Selection(name, frames, every, intrinsics), source)
    return DataSet(folder.name, sequences=(LabelledSequence(folder.name, sequence, _truth_of(folder)),))


def dataset_kind(folder: Path) -> str | None:
    """Which data set's layout a folder has, complete or not. None if it has no known one."""
    if is_osd(folder):
        return "OSD"
    if is_uw_scenes(folder):
        return "RGB-D Scenes v2"
    if is_tum(folder):
        return "TUM RGB-D"
    if is_seven_scenes(folder):
        return "7-Scenes"
    return "RGB-D Scenes 2011" if is_rgbd_scenes(folder) else None


def datasets_below(root: Path) -> list[Path]:
    """Folders of data sets: the root itself, or those up to two folders below it, by name."""
    if not root.is_dir():
        raise SourceError(f"{root} is not a folder; give the one that contains the data sets")
    level, found = [root], list[Path]()
    for _ in range(DEPTH + 1):
        found += [folder for folder in level if dataset_kind(folder) is not None]
        level = [
            inner for folder in level if folder not in found for inner in sorted(folder.iterdir()) if inner.is_dir()
        ]
    return found


def distinctly_named(datasets: dict[str, DataSet]) -> list[DataSet]:
    """Data sets by the paths they were opened with. Equal names get their parent folders as a prefix."""
    parts = {path: Path(path).resolve().parts for path in datasets}
    told = []
    for path, dataset in datasets.items():
        rivals = [parts[other] for other, one in datasets.items() if other != path and one.name == dataset.name]
        length = 1
        while any(rival[-length:] == parts[path][-length:] for rival in rivals) and length < len(parts[path]):
            length += 1
        name = "/".join(parts[path][-length:]) if rivals else dataset.name
        sequences = tuple(replace(s, name=name + s.name.removeprefix(dataset.name)) for s in dataset.sequences)
        told.append(replace(dataset, name=name, sequences=sequences) if rivals else dataset)
    return told


def at_half_size(dataset: DataSet) -> DataSet:
    """The same data set with every second pixel, unless it is halved already. 3D truth is unchanged."""
    if dataset.halved:
        return dataset

    def halved(read: Callable[[], LabelledFrame]) -> LabelledFrame:
        full = read()
        unjudged = None if full.unjudged is None else full.unjudged[::2, ::2]
        return LabelledFrame(halve(full.frame), full.boxes / 2, unjudged)

    readers = tuple(partial(halved, read) for read in dataset.readers)
    sequences = tuple(replace(item, sequence=item.sequence.at_half_size()) for item in dataset.sequences)
    return replace(dataset, readers=readers, sequences=sequences, halved=True)


def both_sizes(datasets: list[DataSet]) -> list[tuple[DataSet, str]]:
    """Each data set with sequences, as it is and at half size (unless it is halved already), with its image size."""
    pairs = []
    for dataset in datasets:
        for sized in (dataset,) if dataset.halved else (dataset, at_half_size(dataset)):
            if sized.sequences:
                camera = sized.sequences[0].sequence.intrinsics
                pairs.append((sized, f"{camera.width}x{camera.height}"))
    return pairs


def _has_own_camera(name: str, intrinsics: FocalAndCentre | None) -> None:
    if intrinsics is not None:
        raise SourceError(f"{name} has its own camera; omit --intrinsics")


def _truth_of(folder: Path) -> LabelledScene | None:
    try:
        if (folder / "labels.json").is_file():
            return read_labelled_scene(folder)
        if (folder / "truth_objects.txt").is_file():
            boxes = read_cuboids(folder / "truth_objects.txt")
            names = tuple(f"cuboid {number}" for number in range(1, len(boxes) + 1))
            labels = tuple(range(1, len(boxes) + 1))
            up = np.array((0.0, 0.0, 1.0))
            return LabelledScene(names, labels, boxes, up, np.zeros((0, 3), np.float32), np.zeros(0, np.uint8))
    except (ValueError, FileNotFoundError) as error:
        raise SourceError(str(error)) from error
    return None
