"""One run of all cores in a process of its own, so that its memory is its own; run as `python -m`, it prints JSON."""

import json
import os
import subprocess
import sys
import time
from typing import Any

import numpy as np
from sklearn.cluster import DBSCAN

from spot3d.bench.timing import Timed, alternate, peak_memory_mb
from spot3d.dataflow.process_use import KEEPING_MEMORY, SINGLE_THREADED, stay_single_threaded
from spot3d.pipeline import PipelineStep, run_pipeline
from spot3d.settings import load_settings
from spot3d.source.selected import Selection, open_selection

_STAGES = ("pose", "proposals", "heatmap", "fusion")
"""Those that work on every frame."""


def whole_run(name: str, frames: int | None, halved: bool) -> dict[str, Any]:
    """What `measure` says, from a fresh process with a stage's environment.

    Raises RuntimeError with that process's last words.
    """
    words = [name, str(frames or 0), "half" if halved else "full"]
    done = subprocess.run(
        [sys.executable, "-m", "spot3d.bench.whole_run", *words],
        env=os.environ | SINGLE_THREADED | KEEPING_MEMORY,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"the pipeline failed on {name}: {(done.stderr.strip().splitlines() or ['?'])[-1]}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def measure(name: str, frames: int | None, halved: bool) -> dict[str, Any]:
    """Times of a frame by stage, its CPU time, memory, and updates of the objects beside DBSCAN.

    Settings are the user's; poses are KISS-ICP's. The first frame is left out: it loads the kernels.
    """
    stay_single_threaded()
    settings = load_settings(overrides={"source": {"halved": halved}})
    sequence = open_selection(Selection(name, frames), settings.source)
    clock = _Clock()
    result = run_pipeline(sequence, settings, clock.frame_done, clock=clock)
    memory = peak_memory_mb()
    points = result.fusion.frequent_points()
    hot = points.xyz[points.heat >= settings.fusion.heat_min]
    dbscan = DBSCAN(eps=settings.fusion.density_radius, min_samples=settings.fusion.density_points)
    timings = alternate([Timed(lambda: dbscan.fit_predict(hot), 1)], 2) if len(hot) else []
    stages = [result.step_s[stage] for stage in _STAGES if stage in result.step_s]
    steps = [sum(times) for times in zip(*stages, strict=False)][1:] or [0.0]
    updates = result.step_s.get("objects", [])
    # The first half is of a map that is still small.
    late = updates[len(updates) // 2 :] or [0.0]
    return {
        "frames": len(sequence),
        "fused": result.fusion.frame_count,
        "width": sequence.intrinsics.width,
        "height": sequence.intrinsics.height,
        "frame_ms": 1e3 * float(np.median(steps)),
        "frame_p99_ms": 1e3 * float(np.percentile(steps, 99)),
        "cpu_ms": 1e3 * clock.core_cpu_s() / max(1, len(sequence) - 1),
        "stage_ms": {
            stage: 1e3 * float(np.median(times[1:] or times)) for stage, times in result.step_s.items() if times
        },
        "segments_share_ms": 1e3 * sum(result.step_s.get("segments", [])) / len(sequence),
        "objects_share_ms": 1e3 * sum(updates) / len(sequence),
        "peak_mb": memory,
        "map_points": result.fusion.heatmap.count,
        "frequent_points": len(points),
        "hot_points": len(hot),
        "update_ms": 1e3 * float(np.median(late)),
        "update_most_ms": 1e3 * float(max(updates, default=0.0)),
        "keyframes": len(result.step_s.get("segments", [])),
        "dbscan_ms": timings[0].median_ms if timings else None,
    }


class _Clock:
    """Seconds for the pipeline; notes the CPU time at each reading, which come in pairs, the source's first."""

    def __init__(self) -> None:
        self._readings: list[float] = []
        self._frames = [0]

    def __call__(self) -> float:
        self._readings.append(time.process_time())
        return time.perf_counter()

    def frame_done(self, _: PipelineStep) -> None:
        """The readings so far belong to this frame and those before."""
        self._frames.append(len(self._readings))

    def core_cpu_s(self) -> float:
        """CPU seconds of all cores for all frames but the first; reading the frames is left out."""
        times = np.array(self._readings).reshape(-1, 2)
        spent = times[:, 1] - times[:, 0]
        spent[[first // 2 for first in self._frames[:-1]]] = 0
        return float(spent[self._frames[min(1, len(self._frames) - 1)] // 2 :].sum())


if __name__ == "__main__":
    input_name, count, size = sys.argv[1:]
    json.dump(measure(input_name, int(count) or None, size == "half"), sys.stdout)
