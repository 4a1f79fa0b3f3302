"""The objects of a single frame, without fusion over time (paper, Sec. VI-A, RGBD scenes)."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.frame_segments import BELOW_SUPPORT, NO_SUPPORT, TOO_LONG, TOO_MANY, FrameSegments
from spot3d.geometry.downsampling import LatticeFrame, to_lattice
from spot3d.geometry.normals import surface_normals
from spot3d.geometry.planes import dominant_planes
from spot3d.geometry.standing import stands_on
from spot3d.segments.contained import join_contained
from spot3d.segments.creases import split_at_creases
from spot3d.segments.faults import covers_least, fault_of
from spot3d.segments.foreground import long_pieces, standing_out
from spot3d.segments.fragments import join_fragments
from spot3d.segments.hanging import STANDS, join_hanging
from spot3d.segments.holes import fill_holes, join_across_holes
from spot3d.segments.labels import pixels_of
from spot3d.segments.levels import Levels, with_lower
from spot3d.segments.occlusion import join_occluded
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import (
    FACING,
    beside_support,
    choose_support,
    expected_up,
    heights_and_tolerance,
    held_heat,
)
from spot3d.segments.torn import join_torn
from spot3d.segments.vessels import join_vessels
from spot3d.segments.walls import is_wall
from spot3d_schemas.limits import MAX_SEGMENTS

_TRIM = 0.005
"""Share of a part's pixels that may lie above a lower support than the part's own."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePlanes:
    """The planes of a view among which heat decides which one is the support.

    points: (h, w, 3) float32 metres, camera frame, z = 0 invalid; normals: (h, w, 3) float32 unit, zeros where there is
    none; planes: (n, 4), normals towards the camera; heat: (n,) heat that each plane holds (see `held_heat`).
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    planes: NDArray[np.float64]
    heat: NDArray[np.float64]


def find_segments(
    colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    heat: NDArray[np.uint8],
    camera: Intrinsics,
    settings: SegmentsSettings,
) -> FrameSegments:
    """The objects of one frame, on its lattice of about `lattice_width` samples across.

    colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths; camera: their
    intrinsics. Without a supporting plane there are no objects: nothing is known to stand on anything.
    """
    frame = to_lattice(colour, depth, heat, camera, settings.lattice_width, settings.grazing_cos)
    return find_on_lattice(frame, candidate_planes(frame, settings), settings)


def candidate_planes(frame: LatticeFrame, settings: SegmentsSettings) -> CandidatePlanes:
    """The planes of a frame on its lattice that may be the support."""
    points, noise = back_project(frame.depth, frame.camera), frame.camera.noise
    normals = surface_normals(frame.depth, frame.camera)
    planes = dominant_planes(points, settings, np.random.default_rng(settings.seed), noise=noise)
    return CandidatePlanes(points, normals, planes, held_heat(planes, points, normals, frame.heat, settings, noise))


def find_on_lattice(
    frame: LatticeFrame, among: CandidatePlanes, settings: SegmentsSettings, upwards: NDArray[np.float64] | None = None
) -> FrameSegments:
    """The objects of one frame on its lattice; see `find_segments` and `candidate_planes`.

    upwards: (3,) unit, camera frame; None = only `settings.image_up` is known.
    """
    points, planes = among.points, among.planes
    if upwards is None:
        upwards = expected_up(settings.image_up)
    support = choose_support(planes, among.heat, upwards)
    if support is None:
        nothing = np.zeros(frame.depth.shape, np.float32)
        levels = Levels(planes[:0], nothing.astype(np.int8), nothing, nothing)
        return _segments([], frame, among, levels, Counter({NO_SUPPORT: 1}), settings)
    levels, out, long = _standing_out(frame, among, support, settings)
    regions, below = _surfaces(frame, among, support, levels.height, out, settings)
    candidates = [(part, fault_of(part, frame, points, levels.height, settings)) for part in pixels_of(regions)]
    left_out = Counter(fault for _, fault in candidates if fault)
    left_out[BELOW_SUPPORT] = sum(covers_least(points.reshape(-1, 3)[part], frame, settings) for part in below)
    parts, up = [part for part, fault in candidates if not fault], support[:3]
    if "occluded" not in settings.skipped:
        parts = join_occluded(parts, points, among.normals, up)
    if "hanging" not in settings.skipped:
        too_long = (part for part, fault in candidates if fault == TOO_LONG)
        parts = join_hanging(parts, points, levels.height.ravel(), up, np.concatenate([long, *too_long]))
    if "contained" not in settings.skipped:
        parts = join_contained(parts, points, among.normals, up)
    if "holes" not in settings.skipped:
        parts = join_across_holes(parts, frame.depth, frame.colour, levels.height)
    return _segments(parts, frame, among, levels, left_out, settings)


def _standing_out(
    frame: LatticeFrame, among: CandidatePlanes, support: NDArray[np.float64], settings: SegmentsSettings
) -> tuple[Levels, NDArray[np.bool_], NDArray[np.int64]]:
    """The supports; (h, w) bool, the pixels above or beside them; and the flat indices of pixels on pieces of other
    planes that are longer than an object."""
    points, normals, noise = among.points, among.normals, frame.camera.noise
    height, tolerance = heights_and_tolerance(points, support, settings, noise)
    levels = Levels(support[None], np.zeros(height.shape, np.int8), height, tolerance)
    off = (np.abs(height) > tolerance) | (normals @ support[:3].astype(np.float32) <= FACING)
    others = [
        (plane, long_pieces(points, normals, off, plane, settings, noise))
        for plane in among.planes
        if (plane != support).any()
    ]
    beside = np.zeros(height.shape, np.bool_)
    if "beside" not in settings.skipped:
        beside = beside_support(points, normals, height, tolerance, support[:3], settings)
    if "levels" not in settings.skipped:
        levels = with_lower(levels, beside, others, points, settings, noise)
        beside &= levels.number == 0
    if "support" in settings.skipped:
        return levels, (frame.depth > 0) & (frame.depth <= settings.range_max), np.zeros(0, np.int64)
    long = np.logical_or.reduce([np.zeros_like(beside), *(pieces for _, pieces in others)])
    out = standing_out(points, levels.height, levels.tolerance, beside, long, settings)
    return levels, out, np.flatnonzero(long)


def _surfaces(
    frame: LatticeFrame,
    among: CandidatePlanes,
    support: NDArray[np.float64],
    height: NDArray[np.float32],
    out: NDArray[np.bool_],
    settings: SegmentsSettings,
) -> tuple[NDArray[np.int32], list[NDArray[np.int64]]]:
    """The (h, w) region labels, from 0, of the pixels `out`, and the regions below the support (see `_risen`).

    Regions are split at creases. Then the sides of vessels, pieces beside a hole in depth and fragments are joined."""
    points, normals, camera = among.points, among.normals, frame.camera
    least = int(settings.region * camera.fx * camera.fy)
    colour = frame.colour if "colour" not in settings.skipped else None
    regions = split_at_creases(points, normals, out, colour, camera.fx, settings.crease, least)
    regions, below = _risen(regions, height)
    if "vessels" not in settings.skipped:
        regions = join_vessels(regions, points, normals, support[:3], settings.size_max, camera.noise)
    if "torn" not in settings.skipped:
        regions = join_torn(regions, points, normals, least, camera.noise)
    if "fragments" not in settings.skipped:
        regions = join_fragments(regions, points, camera.fx, least, settings.size_min)
    return regions, below


def _risen(labels: NDArray[np.int32], height: NDArray[np.float32]) -> tuple[NDArray[np.int32], list[NDArray[np.int64]]]:
    """The labels without regions that nowhere rise above the support, since they stand on something lower; and the
    pixels of each of these."""
    risen = np.zeros(int(labels.max(initial=-1)) + 2, np.bool_)  # the last entry is for label -1
    risen[labels[height > 0]] = True
    rises = risen.take(labels)
    return np.where(rises, labels, np.int32(-1)), pixels_of(np.where(rises, np.int32(-1), labels))


def _segments(
    parts: list[NDArray[np.int64]],
    frame: LatticeFrame,
    among: CandidatePlanes,
    levels: Levels,
    left_out: Counter[str],
    settings: SegmentsSettings,
) -> FrameSegments:
    """The parts as segments, the largest first and at most MAX_SEGMENTS, with their holes filled.

    A piece of a wall holds no heat: it has a vote on what is not part of it, and is no object itself. levels: the
    supports that the parts may stand on.
    """
    left_out[TOO_MANY] = max(0, len(parts) - MAX_SEGMENTS)
    parts = sorted(parts, key=len, reverse=True)[:MAX_SEGMENTS]
    labels = np.zeros(frame.depth.shape, np.int32)
    clear = levels.height - levels.tolerance  # height above the support beyond noise
    up = levels.planes[0, :3] if len(levels.planes) else np.zeros(3)
    heat, stand_on = np.zeros(len(parts), np.float32), np.full(len(parts), -1, np.int8)
    for number, pixels in enumerate(parts):
        labels.ravel()[pixels] = number + 1
        if "walls" in settings.skipped or not is_wall(pixels, frame, among.points, among.normals, up, settings):
            heat[number] = frame.heat.ravel()[pixels].mean() / 255
        if stands_on(pixels, clear, among.points, up, STANDS):
            stand_on[number] = levels.of(pixels, _TRIM)
    if "holes" not in settings.skipped:
        labels = fill_holes(labels, frame.depth, frame.colour, frame.camera.fx)
    counts = {reason: count for reason, count in left_out.items() if count}
    return FrameSegments(labels.astype(np.uint8), heat, levels.planes, stand_on, frame.camera, counts)
