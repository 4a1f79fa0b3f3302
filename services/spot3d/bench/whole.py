"""The pipeline in one process, and the clustering of the map that it leaves."""

from collections.abc import Callable, Sequence
from pathlib import Path

from spot3d.bench.whole_run import whole_run
from spot3d.evaluate.table import Column, Table
from spot3d_schemas import STAGES

_STEPS = (*STAGES[1:], "objects")


def pipeline_tables(inputs: Sequence[tuple[str, int | None]], say: Callable[[str], None]) -> list[Table]:
    """Both tables for inputs, each with how many frames (None: all), at full and half size."""
    pipeline = Table(
        "pipeline",
        "The pipeline in one process",
        (
            *(Column("data"), Column("size"), Column("frames"), Column("ms a frame", 1), Column("p99 ms", 1)),
            *(Column("CPU ms a frame", 1), *(Column(f"{stage} ms", 1) for stage in _STEPS)),
            *(Column("segments ms a frame", 1), Column("objects ms a frame", 1)),
            *(Column("peak MB", 0), Column("map points")),
        ),
        notes=[
            "Medians; reading or rendering frames is in no time, but in the memory. ms a frame: pose, proposals, "
            "heatmap and fusion. Segments: of one keyframe, objects: of one update; and of all, shared by the frames. "
            "CPU: all of these.",
        ],
    )
    clustering = Table(
        "clustering",
        "An update of the objects",
        (
            *(Column("data"), Column("size"), Column("keyframes"), Column("ms"), Column("most ms")),
            *(Column("frequent points"), Column("DBSCAN's points"), Column("DBSCAN ms")),
            Column("reference / ours", 1),
        ),
        notes=[
            "Median of the second half of the run's updates, each with the keyframes of a second, and the longest.",
            "Reference: scikit-learn's DBSCAN with the paper's radius and count on all selected points (those seen "
            "often enough whose heat passes eps).",
        ],
    )
    for name, frames in inputs:
        for halved in (False, True):
            say(f"pipeline: {name}{', half size' if halved else ''} ...")
            found = whole_run(name, frames, halved)
            where = (Path(name).name, f"{found['width']}x{found['height']}")
            stages = [found["stage_ms"].get(stage) for stage in _STEPS]
            pipeline.add(
                *where,
                found["frames"],
                found["frame_ms"],
                found["frame_p99_ms"],
                found["cpu_ms"],
                *stages,
                found["segments_share_ms"],
                found["objects_share_ms"],
                found["peak_mb"],
                found["map_points"],
            )
            dbscan = found["dbscan_ms"]
            clustering.add(
                *where,
                found["keyframes"],
                found["update_ms"],
                found["update_most_ms"],
                found["frequent_points"],
                found["hot_points"],
                dbscan,
                dbscan / found["update_ms"] if dbscan is not None and found["update_ms"] else None,
            )
    return [pipeline, clustering]
