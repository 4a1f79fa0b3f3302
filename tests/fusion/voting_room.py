"""Keyframes of the made-up room, with the objects of each as a perfect segmenter would tell them, or a worse one."""

import numpy as np
from fusion_room import CAMERA, COARSE, ROOM, THREE, Cuboid, orbit, view
from numpy.typing import NDArray

from spot3d.boxes import iou_matrix_3d
from spot3d.camera import invert
from spot3d.found_object import FoundObject, FoundObjects
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.geometry.planes import transform_plane

TABLE_PLANE = np.array([0.0, 0.0, 1.0, 0.0])
SETTINGS = COARSE
POSES = orbit(12)
Pose = NDArray[np.float64]


def keyframe(
    pose: Pose,
    things: tuple[Cuboid, ...] = THREE,
    labels: dict[int, int] | None = None,
    *,
    number: int = 0,
    shown: tuple[Cuboid, ...] | None = None,
    room: tuple[Cuboid, ...] = ROOM,
    supports: tuple[float, ...] = (0.0,),
    heat: float = 0.6,
    told: Pose | None = None,
) -> Keyframe:
    """What a camera at `pose` sees, each thing with a label of its own.

    labels: which label a thing has, 0 = none, by its row; default: its row and 1. shown: the things that stand there,
    `things` and others. supports: the height of each support, the main one first; a thing stands on that which its
    bottom is at. told: the pose that is told instead.
    """
    seen = view(pose, (*room, *(things if shown is None else shown)))
    image = np.zeros(CAMERA.shape, np.uint8)
    names = {row: row + 1 for row in range(len(things))} if labels is None else labels
    count = max(names.values(), default=0)
    stands_on = np.full(count, -1, np.int8)
    for row, name in names.items():
        image[(seen.colour == things[row].colour).all(axis=-1)] = name
        bottom = things[row].centre[2] - things[row].size[2] / 2
        near = [number for number, height in enumerate(supports) if abs(height - bottom) < 1e-6]
        if name and near:
            stands_on[name - 1] = near[0]
    planes = [transform_plane(TABLE_PLANE - (0, 0, 0, height), invert(pose)) for height in supports]
    return Keyframe(
        number,
        image,
        seen.colour,
        seen.depth,
        CAMERA,
        pose if told is None else told,
        np.full(count, heat, np.float32),
        np.array(planes).reshape(-1, 4),
        stands_on,
    )


def keyframes(count: int = 12, **words: object) -> list[Keyframe]:
    """Keyframes along an arc in front of the table."""
    return [keyframe(pose, number=number, **words) for number, pose in enumerate(orbit(count))]  # type: ignore[arg-type]


def overlaps(found: list[FoundObject], things: tuple[Cuboid, ...] = THREE) -> NDArray[np.float64]:
    """IoU of each true box (rows) and each found one."""
    return iou_matrix_3d([thing.box() for thing in things], [item.box for item in found])


def agreed(frames: list[Keyframe], **changes: object) -> FoundObjects:
    return ViewConsensus(SETTINGS.model_copy(update=changes)).update(frames)


def assert_found(agreed: FoundObjects, things: tuple[Cuboid, ...] = THREE, least: float = 0.8) -> None:
    """Each thing has one box of its own, and there are no others."""
    iou = overlaps(agreed.objects, things)
    assert iou.shape == (len(things), len(things)), f"{len(agreed.objects)} objects; left out: {agreed.left_out}"
    assert sorted(iou.argmax(axis=1).tolist()) == list(range(len(things)))
    assert (iou.max(axis=1) > least).all(), iou.max(axis=1)


def described(agreed: FoundObjects, numbered: bool = True) -> NDArray[np.float64]:
    """All of every object, a row each, with or without its number, ordered by place."""
    objects = sorted(agreed.objects, key=lambda item: np.round(item.box.centre, 3).tolist())
    rows = [
        (
            *(float(item.id if numbered else 0), item.confidence, float(item.views), float(item.points)),
            *(*item.colour.tolist(), *item.box.centre.tolist(), *item.box.size.tolist()),
            *item.box.rotation.ravel().tolist(),
        )
        for item in objects
    ]
    return np.array(rows).reshape(len(rows), -1)


def assert_same(one: FoundObjects, other: FoundObjects, numbered: bool = False) -> None:
    """The same objects, but for rounding."""
    np.testing.assert_allclose(described(one, numbered), described(other, numbered), atol=1e-6)
    assert one.left_out == other.left_out
