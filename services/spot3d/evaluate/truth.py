"""Reads ground truth, and the boxes of a finished run, from files.

All raise FileNotFoundError for a missing file, SourceError for one that is not UTF-8, and ValueError for a broken one,
naming it and its field or line.
"""

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, FiniteFloat, ValidationError, field_validator

from spot3d.boxes import Box3D
from spot3d.evaluate.points import points_in_boxes
from spot3d.source.text_files import read_text

Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Matrix = tuple[Vector, Vector, Vector]

_TRUE_MOST_M = 20.0
"""Largest accepted side of a true object: a box of 2 cm in millimetres."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledScene:
    """A scene's true objects and labelled cloud, in the world frame.

    names, labels, boxes: one entry per object; labels are the values that `label` uses for its points.
    up: (3,) float64 unit normal of the supporting plane. xyz: (N, 3) float32 metres.
    label: (N,) uint8, 0 = background, 255 = ignored, others = the object of that label.
    """

    names: tuple[str, ...]
    labels: tuple[int, ...]
    boxes: tuple[Box3D, ...]
    up: NDArray[np.float64]
    xyz: NDArray[np.float32]
    label: NDArray[np.uint8]


class _MinAreaBox(BaseModel):
    centre: Vector
    size: Vector
    yaw_rad: FiniteFloat


class _LabelledObject(BaseModel):
    name: str
    label: int = Field(ge=1, le=254)  # 0 is background, 255 ignored
    min_area_box: _MinAreaBox


class _Labels(BaseModel):
    R_aligned_world: Matrix
    plane_offset: FiniteFloat
    objects: list[_LabelledObject]

    @field_validator("objects")
    @classmethod
    def _each_has_its_own_label(cls, objects: list[_LabelledObject]) -> list[_LabelledObject]:
        name_of: dict[int, str] = {}
        for item in objects:
            if item.label in name_of:
                both = f"{name_of[item.label]} and {item.name}"
                raise ValueError(f"{both} have the same label, {item.label}; give each object its own")
            name_of[item.label] = item.name
        return objects


class _FoundObject(BaseModel):
    id: int
    centre: Vector
    size: Vector
    rotation: Matrix


class _Objects(BaseModel):
    objects: list[_FoundObject]


Model = TypeVar("Model", bound=BaseModel)


def read_labelled_scene(folder: Path) -> LabelledScene:
    """True boxes and labelled points from a folder with `labels.json` and `labelled_cloud.npz`.

    The file's boxes stand upright in an aligned frame whose z is the height above the supporting plane:
    p_aligned = R_aligned_world @ p_world - (0, 0, plane_offset); yaw turns the box's x axis about that z.
    """
    path = folder / "labels.json"
    labels = _read_json(path, _Labels)
    R_world_aligned = np.array(labels.R_aligned_world, dtype=np.float64).T
    plane_offset = np.array((0.0, 0.0, labels.plane_offset))
    boxes = []
    for item in labels.objects:
        shape = item.min_area_box
        centre = R_world_aligned @ (np.array(shape.centre) + plane_offset)
        boxes.append(_true_box(path, item.name, centre, shape.size, R_world_aligned @ _yaw(shape.yaw_rad)))
    xyz, label = _read_labelled_cloud(folder / "labelled_cloud.npz")
    for item, box in zip(labels.objects, boxes, strict=True):
        its_points = xyz[label == item.label]
        if len(its_points) and not points_in_boxes(its_points, [box]).any():
            raise ValueError(
                f"{path}, {item.name}: its box contains none of its {len(its_points)} points in labelled_cloud.npz; "
                "give both in metres, and the points in the world of the poses"
            )
    return LabelledScene(
        names=tuple(item.name for item in labels.objects),
        labels=tuple(item.label for item in labels.objects),
        boxes=tuple(boxes),
        up=R_world_aligned[:, 2],
        xyz=xyz,
        label=label,
    )


def read_cuboids(path: Path) -> tuple[Box3D, ...]:
    """True boxes from a TUM-style `truth_objects.txt`; world frame with z up.

    One box a line: x y z yaw half_length half_width half_height, in metres and radians; `#` begins a comment.
    """
    boxes = []
    for number, line in enumerate(read_text(_existing(path)).splitlines(), start=1):
        fields = line.split("#", 1)[0].split()
        if not fields:
            continue
        try:
            x, y, z, yaw, *half = (float(field) for field in fields)
        except ValueError as error:
            raise ValueError(f"{path}, line {number}: expected 7 numbers, got {line!r}") from error
        if len(half) != 3:
            raise ValueError(f"{path}, line {number}: expected 7 numbers, got {len(fields)}")
        size = (2 * half[0], 2 * half[1], 2 * half[2])
        boxes.append(_true_box(path, f"line {number}", np.array((x, y, z)), size, _yaw(yaw)))
    return tuple(boxes)


def read_found_boxes(path: Path) -> tuple[Box3D, ...]:
    """Boxes of a run's objects from its `objects.json`; world frame, metres."""
    return tuple(
        _box(path, f"object {item.id}", np.array(item.centre), item.size, np.array(item.rotation))
        for item in _read_json(path, _Objects).objects
    )


def _yaw(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def _true_box(path: Path, name: str, centre: NDArray[np.float64], size: Vector, rotation: NDArray[np.float64]) -> Box3D:
    if max(size) > _TRUE_MOST_M:
        raise ValueError(f"{path}, {name}: a side of {max(size):g} m is implausibly long; give boxes in metres")
    return _box(path, name, centre, size, rotation)


def _box(path: Path, name: str, centre: NDArray[np.float64], size: Vector, rotation: NDArray[np.float64]) -> Box3D:
    try:
        return Box3D(centre, np.array(size), rotation)
    except ValueError as error:
        raise ValueError(f"{path}, {name}: {error}") from error


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing")
    return path


def _read_json(path: Path, model: type[Model]) -> Model:
    try:
        return model.model_validate(json.loads(read_text(_existing(path))))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the document"
        raise ValueError(f"{path}: {where}: {first['msg']}") from error
    except ValueError as error:
        raise ValueError(f"{path} is not valid JSON: {error}") from error


def _read_labelled_cloud(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    try:
        with np.load(_existing(path), allow_pickle=False) as archive:
            xyz, label = archive["xyz_world"], archive["label"]
    except (EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: expected an archive (.npz) with xyz_world and label: {error}") from error
    if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype.kind != "f":
        raise ValueError(f"{path}: xyz_world must be floats (N, 3), got {xyz.dtype} {xyz.shape}")
    if label.shape != (len(xyz),) or label.dtype != np.uint8:
        raise ValueError(f"{path}: label must be uint8 ({len(xyz)},), got {label.dtype} {label.shape}")
    return xyz.astype(np.float32, copy=False), label
