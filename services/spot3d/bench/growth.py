"""Cost as the map grows: time of fusing against map size, of updates against keyframes."""

import time
from collections.abc import Callable
from functools import cache

import numpy as np

from spot3d.bench.material import Material, to_and_fro
from spot3d.bench.timing import peak_memory_mb
from spot3d.camera_pose import CameraPose
from spot3d.dataflow.cadence import Cadence
from spot3d.dataflow.process_use import process_use
from spot3d.drawing.charts import Line, line_chart
from spot3d.drawing.picture import Picture
from spot3d.evaluate.table import Column, Table, columns
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.segments.finder import find_segments
from spot3d.segments.keyframes import Keyframes
from spot3d.settings import Settings

ROOM = 6.0
"""Shift between one pass through the frames and the next, metres, so that each pass sees another room."""
CHECKPOINTS = 8
_FRAME_NS = 1e9 / 30


def map_growth(material: Material, length: int, settings: Settings, say: Callable[[str], None]) -> Table:
    """Fuse `length` frames on a path through new rooms, with updates of the objects as in a run."""
    table = Table(
        "map growth",
        f"Cost against map size, {material.data} at {material.size} on a long path",
        (
            *columns("frames", "map points", "fuse ms", "fuse p99 ms", "keyframes"),
            *columns("update ms", "longest ms", digits=1),
            Column("memory MB", 0),
        ),
    )
    fusion, times, updates = Fusion(settings.fusion), list[float](), list[float]()
    keyframes, cadence = Keyframes(settings.segments), Cadence(settings.fusion.object_interval_s)
    stops = {round(stop) for stop in np.geomspace(min(100, length), length, CHECKPOINTS)}
    turn = max(1, len(material) - 1)

    @cache
    def segments_of(index: int) -> FrameSegments:
        frame, depth, heat = material.frames[index], material.depth[index], material.heat[index]
        return find_segments(frame.colour, depth, heat, material.camera, settings.segments)

    for step in range(length):
        index, stamp_ns = to_and_fro(len(material), step), round(step * _FRAME_NS)
        colour, depth, heat = material.frames[index].colour, material.depth[index], material.heat[index]
        pose = material.pose(index).copy()
        pose[0, 3] += ROOM * (step // turn)
        segments = segments_of(index) if keyframes.is_keyframe(stamp_ns, pose) else None
        start = time.perf_counter()
        fusion.fuse(colour, depth, heat, material.camera, CameraPose(pose), stamp_ns)
        if segments is not None:
            fusion.observe(segments, stamp_ns)
        times.append(time.perf_counter() - start)
        last = step + 1 in stops
        if cadence.due(stamp_ns) or last:
            start = time.perf_counter()
            fusion.objects()
            updates.append(time.perf_counter() - start)
        if not last:
            continue
        say(f"growth: {step + 1} frames ...")
        median, p99 = 1e3 * np.percentile(times[1:] or times, (50, 99))
        table.add(
            *(step + 1, fusion.heatmap.count, float(median), float(p99), len(fusion.consensus)),
            *(1e3 * float(np.median(updates)), 1e3 * max(updates)),
            process_use().rss_bytes / 2**20,
        )
        times.clear()
        updates.clear()
    table.notes.append(
        f"Every {turn} frames the path goes on into another room, {ROOM:g} m further, so that the map grows for as "
        f"long as it may (map_limit: {settings.fusion.map_limit}, keyframe_limit: {settings.fusion.keyframe_limit}). "
        "An update has the keyframes of a second. Times are of the frames since the row before. Peak memory "
        f"of this process: {peak_memory_mb():.0f} MB."
    )
    return table


def charts(growth: Table) -> dict[str, Picture]:
    """Pictures of the table, by file name."""
    heads = [column.name for column in growth.columns]

    def line(name: str, x: str, y: str) -> Line:
        cells = [(row[heads.index(x)], row[heads.index(y)]) for row in growth.rows]
        known = [(float(a), float(b)) for a, b in cells if isinstance(a, int | float) and isinstance(b, int | float)]
        return Line(name, sorted(known))  # a full map loses points: it does not grow from row to row

    fusing = [line("median", "map points", "fuse ms"), line("p99", "map points", "fuse p99 ms")]
    updates = [line("median", "frames", "update ms"), line("longest", "frames", "longest ms")]
    return {
        "fusing": line_chart("fusing a frame against map size", "map points", "ms", fusing),
        "updates": line_chart("an update of the objects against the path", "frames", "ms", updates),
    }
