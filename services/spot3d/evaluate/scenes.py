"""The built-in scene as a data set: boxes and a labelled cloud from the renderer's ground truth."""

from functools import partial

import numpy as np

from spot3d.camera import back_project
from spot3d.evaluate.labelled import LabelledFrame, LabelledSequence, Readers, mask_boxes
from spot3d.evaluate.peer import voxel_keys
from spot3d.evaluate.points import IGNORED
from spot3d.evaluate.truth import LabelledScene
from spot3d.source.scene.name import SceneName, parse_scene_name
from spot3d.source.scene.scene import Scene
from spot3d.source.selected import Selection, open_selection
from spot3d.source.settings import SourceSettings

TRUTH_VIEWS = 20
TRUTH_VOXEL = 0.005
SINGLE_FRAMES = 30
"""About this many of a scene's frames, evenly spread, are evaluated one by one: neighbours are nearly the same."""
PIXELS_MIN = 200
"""An object with fewer visible pixels in a VGA frame does not count as a true object."""


def open_scene(
    name: str, source: SourceSettings, every: int = 1, frames: int | None = None
) -> tuple[LabelledSequence, Readers]:
    """The named scene as a labelled sequence, and some of its frames with boxes around the true masks."""
    sequence = open_selection(Selection(name, frames, every), source)
    named = parse_scene_name(name) or SceneName()
    # It ends with the last frame that is played, whose truth is the final one.
    scene = Scene(named.seed, named.kind, every * (len(sequence) - 1) + 1)

    def read(index: int) -> LabelledFrame:
        return LabelledFrame(sequence[index], mask_boxes(scene.truth(every * index).instance, 1, PIXELS_MIN))

    truth = _scene_truth(scene, range(0, len(scene), every))
    looked_at = range(0, len(sequence), max(1, len(sequence) // SINGLE_FRAMES))
    return LabelledSequence(name, sequence, truth), tuple(partial(read, index) for index in looked_at)


def _scene_truth(scene: Scene, indices: range) -> LabelledScene:
    """Boxes of the objects that the frames show, and exact points of evenly spread frames, one in 5 mm.

    Both are of frames after the last change.
    """
    indices = indices[-(-scene.settled_from // indices.step) :]
    xyz, label = [np.zeros((0, 3), np.float32)], [np.zeros(0, np.uint8)]
    pixels = np.zeros(256, np.int64)
    for index in indices[:: max(1, len(indices) // TRUTH_VIEWS)]:
        view, T_world_camera = scene.truth(index), scene.true_pose(index)
        pixels = np.maximum(pixels, np.bincount(view.instance.ravel(), minlength=256))
        points = back_project(view.depth, scene.intrinsics)[::2, ::2].reshape(-1, 3)
        xyz.append((points @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]).astype(np.float32))
        label.append(view.instance[::2, ::2].ravel().astype(np.uint8))
    boxes = [box for box in scene.boxes if pixels[box.id] >= PIXELS_MIN]
    points, labels = np.concatenate(xyz), np.concatenate(label)
    # An object that is hardly visible has no box, so its points are ignored.
    labels[(labels > 0) & ~np.isin(labels, [box.id for box in boxes])] = IGNORED
    # In a voxel, points of interest win over background, which would erode the rims of thin objects.
    order = np.argsort(labels == 0, kind="stable")
    _, first = np.unique(voxel_keys(points[order], TRUTH_VOXEL), return_index=True)
    rows = order[first]
    return LabelledScene(
        tuple(box.name for box in boxes),
        tuple(box.id for box in boxes),
        tuple(boxes),
        scene.up,
        points[rows],
        labels[rows],
    )
