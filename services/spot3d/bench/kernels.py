"""Time of each step of a frame, and of its plain transcription."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.bench import reference, reference_map
from spot3d.bench.consensus_steps import consensus_steps
from spot3d.bench.material import Material, walking
from spot3d.bench.timing import MEASURED, Timed, alternate, measured_row, peak_memory_mb
from spot3d.camera import back_project, invert
from spot3d.camera_pose import CameraPose
from spot3d.evaluate.table import Table
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.index_map import IndexMap
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supporting_plane import supporting_plane
from spot3d.geometry.downsampling import LatticeFrame, to_lattice
from spot3d.geometry.planes import dominant_planes, on_plane, transform_plane
from spot3d.heatmap.heat import weighted_heat
from spot3d.proposals.edges import detect_edges
from spot3d.proposals.propose import propose
from spot3d.settings import Settings

REPEATS, ROUNDS = 12, 4
"""Calls of ours in a round, and rounds; a transcription that takes a second is called once a round."""
SLOW_ROUNDS = 2
TRIPLES = 10_000
"""Triples of the reference's RANSAC (paper, Sec. VI-A)."""
NUMPY = "NumPy transcription"
ABSENT = "OpenCV contrib EdgeBoxes (not installed)"

Call = Callable[[], object]


def kernels_table(materials: Sequence[Material], settings: Settings, say: Callable[[str], None]) -> Table:
    """A row for each material and step: time of ours, of its reference, and of a copy of the bytes that it reads."""
    table = Table("kernels", "Time of each step of a frame", MEASURED)
    for material in materials:
        say(f"kernels: {material.data}, {material.size} ...")
        steps = _Steps(table, material)
        _image_steps(steps, material, settings)
        _plane_steps(steps, material, settings.fusion)
        _map_steps(steps, material, settings.fusion)
        consensus_steps(steps.add, material, settings)
    table.notes += [
        "Medians and 99th percentiles over consecutive frames; ours and the reference measured in alternation.",
        "Copy: the step's input bytes, copied into new memory. One thread, one core.",
        "The transcriptions are spot3d.bench.reference and reference_map, which the tests compare the kernels with; "
        "where a step hangs on the one before (boxes, pixels of the warp, the look-up) they loop.",
        f"RANSAC: {TRIPLES} triples scored on all points of the lattice, for one plane; ours finds up to five.",
        f"Peak memory of this process so far: {peak_memory_mb():.0f} MB.",
    ]
    if _edge_boxes() is None:
        table.notes.append(
            "For EdgeBoxes' own time run this in an environment with opencv-contrib-python-headless in place of "
            "opencv-python-headless (and its model.yml.gz is not needed: it gets the same edges)."
        )
    return table


class _Steps:
    """Measures steps of one material into a table."""

    def __init__(self, table: Table, material: Material) -> None:
        self.table, self.material = table, material

    def add(self, step: str, ours: Call, name: str, theirs: Call | None, slow: bool, read: Sequence[Any]) -> None:
        """A row: ours, the reference (slow: takes about a second), and a copy of the arrays that are read."""
        self.add_all({step: ours}, name, theirs, slow, read)

    def add_all(
        self, ours: Mapping[str, Call], name: str, theirs: Call | None, slow: bool, read: Sequence[Any]
    ) -> None:
        """A row for each step; all have the same reference."""
        calls = [Timed(lambda: [array.copy() for array in read], REPEATS)]
        calls += [Timed(call, REPEATS) for call in ours.values()]
        if theirs is not None:
            calls.append(Timed(theirs, 1 if slow else 2))
        timings = alternate(calls, SLOW_ROUNDS if slow else ROUNDS)
        reference_timing = timings[-1] if theirs is not None else None
        for step, timing in zip(ours, timings[1:], strict=False):
            where = (self.material.data, self.material.size)
            self.table.add(*measured_row(*where, step, timing, name, reference_timing, timings[0]))


def _image_steps(steps: _Steps, m: Material, settings: Settings) -> None:
    """Proposals and heatmap."""
    count, camera, heatmap = len(m), m.camera, settings.heatmap
    colours = [frame.colour for frame in m.frames]
    edges = [
        detect_edges(colour, depth, camera.fx, settings.proposals.edges)
        for colour, depth in zip(colours, m.depth, strict=True)
    ]
    contrib = _edge_boxes()
    steps.add(
        f"proposals, {settings.proposals.max_boxes} boxes",
        walking(count, lambda i: propose(colours[i], m.depth[i], camera, settings.proposals)),
        ABSENT if contrib is None else "OpenCV contrib EdgeBoxes",
        None
        if contrib is None
        else walking(count, lambda i: contrib.getBoundingBoxes(edges[i].magnitude, edges[i].orientation)),
        False,
        [colours[0], m.depth[0]],
    )
    steps.add(
        f"heatmap, {len(m.boxes[0])} boxes",
        walking(count, lambda i: weighted_heat(m.depth[i], camera, m.boxes[i], heatmap)),
        NUMPY,
        walking(
            count,
            lambda i: reference.weighted_heat(
                m.depth[i], camera, m.boxes[i], heatmap.depth_range_min, heatmap.size_min, heatmap.size_max
            ),
        ),
        True,
        [m.depth[0], m.boxes[0]],
    )
    factor = max(1, round(camera.width / settings.fusion.lattice_width))
    if factor > 1:
        steps.add(
            "lattice",
            walking(count, lambda i: _lattice(m, i, settings.fusion)),
            NUMPY,
            walking(count, lambda i: reference.lattice_depth(m.depth[i], factor)),
            False,
            [colours[0], m.depth[0], m.heat[0]],
        )


def _plane_steps(steps: _Steps, m: Material, settings: FusionSettings) -> None:
    """The supporting plane at a keyframe, and its removal from every frame."""
    frames = [_lattice(m, index, settings) for index in range(len(m))]
    points = [back_project(frame.depth, frame.camera) for frame in frames]
    rng = np.random.default_rng(0)
    known = dominant_planes(points[0], settings, rng)

    def keyframe(planes: NDArray[np.float64] | None, index: int) -> object:
        found = dominant_planes(points[index], settings, np.random.default_rng(index), planes)
        return supporting_plane(found, points[index], frames[index].heat, settings)

    def ransac(index: int) -> object:
        flat = points[index].reshape(-1, 3)
        valid = flat[flat[:, 2] > 0]
        return reference.dominant_plane(valid, settings.plane_distance, rng.integers(0, len(valid), (TRIPLES, 3)))

    def removal(index: int) -> object:
        plane = transform_plane(known[0], invert(m.pose(index)))
        inside = on_plane(plane, back_project(frames[index].depth, frames[index].camera), settings)
        return np.where(inside, np.uint8(0), frames[index].heat)

    count = len(m)
    ours = {
        "plane, first keyframe": walking(count, partial(keyframe, None)),
        "plane, keyframe": walking(count, partial(keyframe, known)),
    }
    if len(known):
        ours["plane, other frames"] = walking(count, removal)
    name = f"{TRIPLES}-triple NumPy RANSAC"
    steps.add_all(ours, name, walking(count, ransac), True, [points[0], frames[0].heat])


def _map_steps(steps: _Steps, m: Material, settings: FusionSettings) -> None:
    """Registration with a map that holds all frames, alone and as part of fusing."""
    count = len(m)
    frames = [_lattice(m, index, settings) for index in range(count)]
    heatmap, index_map = Heatmap3D(settings.map_limit, settings.voxel), IndexMap(settings)
    numbers = itertools.count(1)

    def register(index: int) -> object:
        frame = frames[index]
        return index_map.register(
            heatmap, next(numbers), frame.colour, frame.depth, frame.heat, frame.camera, m.pose(index)
        )

    for index in range(count):
        register(index)
    plain = PlainRegistration(frames, m, reference_map.copy_of(heatmap), settings)
    read = [frames[0].colour, frames[0].depth, frames[0].heat]
    ours, theirs = walking(count, register, count), walking(count, plain.register, count)
    theirs()  # makes an index map to warp from, as ours has one
    steps.add("registration (index map)", ours, NUMPY, theirs, True, read)
    fusion = Fusion(settings)

    def fuse(index: int) -> object:
        return fusion.fuse(m.frames[index].colour, m.depth[index], m.heat[index], m.camera, CameraPose(m.pose(index)))

    for index in range(count):
        fuse(index)

    def plain_fuse(index: int) -> object:
        reference.lattice_depth(m.depth[index], max(1, round(m.camera.width / settings.lattice_width)))
        return plain.register(index)

    steps.add(
        "fuse a frame: lattice, plane, registration",
        walking(count, fuse, count),
        "NumPy, without the plane",
        walking(count, plain_fuse, count),
        True,
        [m.frames[0].colour, m.depth[0], m.heat[0]],
    )


class PlainRegistration:
    """Registers frame after frame with a map, by the transcriptions."""

    def __init__(
        self,
        frames: Sequence[LatticeFrame],
        material: Material,
        known: reference_map.ReferenceMap,
        settings: FusionSettings,
    ) -> None:
        self._frames, self._material, self.known, self._settings = frames, material, known, settings
        self._last: tuple[int, NDArray[np.int32]] | None = None
        self._number = 0

    def register(self, number: int) -> object:
        """Warp the last frame's index map into this frame, and merge the frame."""
        settings, frame, pose = self._settings, self._frames[number], self._material.pose(number)
        candidates = np.full(frame.depth.shape, -1, np.int32)
        if self._last is not None:
            last, index = self._last
            before = self._frames[last]
            candidates = reference.warp(
                index,
                before.depth,
                before.colour,
                frame.depth,
                frame.colour,
                invert(pose) @ self._material.pose(last),
                frame.camera,
                settings.colour_gate,
                settings.depth_gate,
            )
        self._number += 1
        found = reference_map.merge(
            self.known,
            candidates,
            frame.depth,
            frame.colour,
            frame.heat,
            pose,
            frame.camera,
            settings.noise_gate,
            settings.range_max,
            self._number,
        )
        self._last = (number, found[0])
        return found


def _lattice(m: Material, index: int, settings: FusionSettings) -> LatticeFrame:
    return to_lattice(
        m.frames[index].colour, m.depth[index], m.heat[index], m.camera, settings.lattice_width, settings.grazing_cos
    )


def _edge_boxes() -> Any | None:
    """OpenCV contrib's EdgeBoxes with 1000 boxes; None where this OpenCV lacks it."""
    contrib = getattr(cv2, "ximgproc", None)
    return None if contrib is None else contrib.createEdgeBoxes(maxBoxes=1000)
