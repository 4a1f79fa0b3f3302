"""Every table by its name: which data sets it needs, and how it is made."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from spot3d.evaluate.cost_tables import poses_table, time_table
from spot3d.evaluate.frame_tables import filters_table, proposals_table
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.measured_run import Runs
from spot3d.evaluate.object_tables import ablations_table, objects_table, points_table, stability_table
from spot3d.evaluate.step_tables import steps_table
from spot3d.evaluate.still_table import still_table
from spot3d.evaluate.table import Table
from spot3d.settings import Settings
from spot3d.source.errors import SourceError

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TableKind:
    """suits: whether a data set has what the table needs; needs: the same in words."""

    make: Callable[[list[DataSet], Settings, Runs, Say], Table]
    suits: Callable[[DataSet], bool]
    needs: str


def _has_frames(dataset: DataSet) -> bool:
    return dataset.frames is not None


def _has_sequences(dataset: DataSet) -> bool:
    return bool(dataset.sequences)


def _has_objects(dataset: DataSet) -> bool:
    return any(item.truth is not None for item in dataset.sequences)


def _has_points(dataset: DataSet) -> bool:
    return any(item.truth is not None and len(item.truth.label) for item in dataset.sequences)


def _has_poses(dataset: DataSet) -> bool:
    return any(item.sequence.has_true_poses for item in dataset.sequences)


TABLES = {
    "proposals": TableKind(
        lambda data, settings, runs, say: proposals_table(data, settings),
        _has_frames,
        "single frames with true 2D boxes (OSD, RGB-D Scenes 2011, scene)",
    ),
    "still": TableKind(
        lambda data, settings, runs, say: still_table(data, settings),
        _has_frames,
        "single frames with true 2D boxes (OSD, RGB-D Scenes 2011, scene)",
    ),
    "steps": TableKind(
        lambda data, settings, runs, say: steps_table(data, settings),
        _has_frames,
        "single frames with true 2D boxes (OSD, RGB-D Scenes 2011, scene)",
    ),
    "filters": TableKind(
        lambda data, settings, runs, say: filters_table(data, settings), lambda dataset: True, "frames"
    ),
    "objects": TableKind(
        lambda data, settings, runs, say: objects_table(data, settings, runs),
        _has_objects,
        "a sequence with true objects (labels.json, truth_objects.txt, RGB-D Scenes v2, scene)",
    ),
    "ablations": TableKind(
        lambda data, settings, runs, say: ablations_table(data, settings, runs),
        _has_objects,
        "a sequence with true objects (labels.json, truth_objects.txt, RGB-D Scenes v2, scene)",
    ),
    "points": TableKind(
        lambda data, settings, runs, say: points_table(data, settings, runs),
        _has_points,
        "a sequence with a labelled cloud (labels.json, RGB-D Scenes v2, scene)",
    ),
    "time": TableKind(lambda data, settings, runs, say: time_table(data, settings, runs), _has_sequences, "a sequence"),
    "poses": TableKind(
        lambda data, settings, runs, say: poses_table(data, settings, say),
        _has_poses,
        "a sequence with true poses (7-Scenes, TUM RGB-D, RGB-D Scenes v2, scene)",
    ),
    "stability": TableKind(
        lambda data, settings, runs, say: stability_table(data, settings, runs),
        _has_objects,
        "a sequence with true objects (labels.json, truth_objects.txt, RGB-D Scenes v2, scene)",
    ),
}
"""In the order in which they are printed."""


def with_objects(datasets: list[DataSet]) -> list[DataSet]:
    """Those of the data sets that have a sequence with true objects. Raises SourceError where none has."""
    chosen = [dataset for dataset in datasets if _has_objects(dataset)]
    if not chosen:
        given = ", ".join(dataset.name for dataset in datasets)
        raise SourceError(f"{given or 'nothing'} is not enough for this table: it needs {TABLES['objects'].needs}")
    return chosen


def make_tables(names: list[str], datasets: list[DataSet], settings: Settings, say: Say) -> Iterator[Table]:
    """The named tables, one by one, each over the data sets that suit it; a table that suits none is left out.

    Raises SourceError at once if that leaves no table.
    """
    suited = {name: [dataset for dataset in datasets if TABLES[name].suits(dataset)] for name in names}
    if not any(suited.values()):
        given = ", ".join(dataset.name for dataset in datasets)
        needs = " or ".join(TABLES[name].needs for name in names)
        raise SourceError(f"{given or 'nothing'} is not enough for this table: it needs {needs}")
    runs = Runs(say)
    return (TABLES[name].make(suited[name], settings, runs, say) for name in names if suited[name])
