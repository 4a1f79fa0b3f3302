"""All tables by name: which data sets each needs, and how it is made."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from spot3d.evaluate.cost_tables import poses_table, time_table
from spot3d.evaluate.frame_tables import filters_table, proposals_table, steps_table
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.measured_run import Runs
from spot3d.evaluate.object_tables import ablations_table, objects_table, points_table, stability_table
from spot3d.evaluate.robustness import frame_robustness_table, robustness_table
from spot3d.evaluate.still_table import moving_table, still_table
from spot3d.evaluate.table import Table
from spot3d.settings import Settings
from spot3d.source.errors import SourceError

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Need:
    """What a table needs of a data set: a test, and a description."""

    met_by: Callable[[DataSet], bool]
    words: str


@dataclass(frozen=True, slots=True)
class TableKind:
    """How a table is made, and what it needs. long: it is made only if it is named."""

    make: Callable[[list[DataSet], Settings, Runs, Say], Table]
    needs: Need
    long: bool = False


_ANY = Need(lambda dataset: True, "frames")
_FRAMES = Need(
    lambda dataset: bool(dataset.readers), "single frames with true 2D boxes (OSD, RGB-D Scenes 2011, scene)"
)
_SEQUENCES = Need(lambda dataset: bool(dataset.sequences), "a sequence")
_OBJECTS = Need(
    lambda dataset: any(item.truth is not None for item in dataset.sequences),
    "a sequence with true objects (labels.json, truth_objects.txt, RGB-D Scenes v2, scene)",
)
_POINTS = Need(
    lambda dataset: any(item.truth is not None and len(item.truth.label) for item in dataset.sequences),
    "a sequence with a labelled cloud (labels.json, RGB-D Scenes v2, scene)",
)
_POSES = Need(
    lambda dataset: any(item.sequence.has_true_poses for item in dataset.sequences),
    "a sequence with true poses (7-Scenes, TUM RGB-D, RGB-D Scenes v2, scene)",
)

TABLES = {
    "proposals": TableKind(lambda data, settings, runs, say: proposals_table(data, settings), _FRAMES),
    "still": TableKind(lambda data, settings, runs, say: still_table(data, settings), _FRAMES),
    "moving": TableKind(lambda data, settings, runs, say: moving_table(data, settings), _FRAMES, long=True),
    "steps": TableKind(lambda data, settings, runs, say: steps_table(data, settings), _FRAMES),
    "filters": TableKind(lambda data, settings, runs, say: filters_table(data, settings), _ANY),
    "objects": TableKind(lambda data, settings, runs, say: objects_table(data, settings, runs), _OBJECTS),
    "ablations": TableKind(lambda data, settings, runs, say: ablations_table(data, settings, runs), _OBJECTS),
    "points": TableKind(lambda data, settings, runs, say: points_table(data, settings, runs), _POINTS),
    "time": TableKind(lambda data, settings, runs, say: time_table(data, settings, runs), _SEQUENCES),
    "poses": TableKind(lambda data, settings, runs, say: poses_table(data, settings, say), _POSES),
    "stability": TableKind(lambda data, settings, runs, say: stability_table(data, settings, runs), _OBJECTS),
}
"""In the order in which they are printed."""
SHORT_TABLES = [name for name, kind in TABLES.items() if not kind.long]


def robustness_tables(
    datasets: list[DataSet], settings: Settings, every: int, only: tuple[str, ...], say: Say
) -> Iterator[Table]:
    """The tables of degraded input: of whole runs, and of single frames of data sets without true objects in runs.

    Raises SourceError at once if there are neither.
    """
    runs = [dataset for dataset in datasets if _OBJECTS.met_by(dataset)]
    frames = [dataset for dataset in datasets if dataset not in runs and _FRAMES.met_by(dataset)]
    if not runs and not frames:
        raise _not_enough(datasets, f"{_OBJECTS.words} or {_FRAMES.words}")
    of_both = (robustness_table, runs), (frame_robustness_table, frames)
    return (make(chosen, settings, every, only, say) for make, chosen in of_both if chosen)


def make_tables(names: list[str], datasets: list[DataSet], settings: Settings, say: Say) -> Iterator[Table]:
    """The named tables, one by one, each over the data sets that meet its need. A table without any is skipped.

    Raises SourceError at once if that leaves no table.
    """
    suited = {name: [dataset for dataset in datasets if TABLES[name].needs.met_by(dataset)] for name in names}
    if not any(suited.values()):
        raise _not_enough(datasets, " or ".join(dict.fromkeys(TABLES[name].needs.words for name in names)))
    runs = Runs(say)
    return (TABLES[name].make(suited[name], settings, runs, say) for name in names if suited[name])


def _not_enough(datasets: list[DataSet], needed: str) -> SourceError:
    given = ", ".join(dataset.name for dataset in datasets)
    return SourceError(f"{given or 'nothing'} is not enough for this table, which needs {needed}")
