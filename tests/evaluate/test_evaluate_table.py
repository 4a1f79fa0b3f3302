"""Tables as Markdown and JSON, plots, projections, records."""

from math import nan
from pathlib import Path

import numpy as np
import pytest

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics
from spot3d.drawing.charts import Curve, recall_plot
from spot3d.evaluate.projection import box_surface, boxes_in_view, thinned
from spot3d.evaluate.record import data_checksum
from spot3d.evaluate.scores import object_scores, recall_of
from spot3d.evaluate.table import Column, Table, to_document, to_markdown, write_plots
from spot3d.evaluate.uw_scenes import split_instances

CAMERA = Intrinsics(100, 100, 50, 50, 101, 101)


def test_markdown() -> None:
    table = Table("t", "Title", (Column("data"), Column("rate"), Column("frames")))
    assert to_markdown(table).splitlines()[2:] == ["| data | rate | frames |", "| ---: | ---: | -----: |"]
    table.add("a|b", 0.456, 12)
    table.add("c", nan, None)
    table.notes.append("Said once.")
    assert to_markdown(table).splitlines() == [
        "### Title",
        "",
        "| data | rate | frames |",
        "| ---- | ---: | -----: |",
        "| a\\|b | 0.46 |     12 |",
        "| c    |    - |      - |",
        "",
        "- Said once.",
    ]
    with pytest.raises(ValueError, match="2 cells for 3 columns"):
        table.add("a", 1)


def test_document() -> None:
    table = Table("t", "Title", (Column("data"), Column("rate")))
    table.add("a", nan)
    table.curves.append(Curve("a", "ours", np.array([0.0, 1.0]), np.array([1.0, nan])))
    assert to_document(table) == {
        "table": "t",
        "title": "Title",
        "columns": ["data", "rate"],
        "rows": [{"data": "a", "rate": None}],
        "notes": [],
        "curves": [{"data": "a", "name": "ours", "iou": [0.0, 1.0], "recall": [1.0, None]}],
    }


@pytest.mark.parametrize(
    ("scenes", "expected"),
    [
        ([], (nan, nan, nan, nan)),
        ([np.zeros((2, 0))], (0, nan, nan, 0)),
        ([np.array([[0.6, 0.1, 0.0]])], (0.6, 0.7 / 3, 1 / 3, 1)),
    ],
)
def test_object_scores(scenes: list[np.ndarray], expected: tuple[float, ...]) -> None:
    np.testing.assert_allclose(object_scores(scenes), expected)


def test_recall_plot(tmp_path: Path) -> None:
    empty = recall_plot("nothing", [])
    curve = recall_of("scene:1", "3D", [np.array([[0.6]])])
    assert curve.recall[0] == 1
    assert curve.recall[-1] == 0
    drawn = recall_plot("nothing", [curve])
    blue = (drawn == (0, 114, 178)).all(axis=2)
    assert not (empty == (0, 114, 178)).all(axis=2).any()
    # The curve runs along the top edge up to IoU 0.6, and along the bottom beyond.
    assert blue[60, 150]
    assert not blue[60, 520]
    assert blue[520, 520]
    table = Table("objects", "Objects", (), curves=[curve, recall_of("other", "3D", [])])
    write_plots(tmp_path / "plots", [table])
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == ["objects-other.png", "objects-scene-1.png"]


def test_a_curve_over_named_levels() -> None:
    curve = Curve(
        "scene:1 holes", "ours", np.array([0.0, 0.5, 1.0]), np.array([1.0, 1.0, nan]), ("0 %", "10 %", "30 %")
    )
    drawn, empty = recall_plot("holes", [curve]), recall_plot("holes", [])
    blue = (drawn == (0, 114, 178)).all(axis=2)
    assert blue[60, 300]
    assert not blue[60, 500], "what is not known is not drawn"
    assert (drawn[530:560, 60:100] != empty[530:560, 60:100]).any(), "levels stand below the axis"
    table = Table("robustness", "Title", (), curves=[curve])
    assert to_document(table)["curves"] == [
        {"data": "scene:1 holes", "name": "ours", "levels": ["0 %", "10 %", "30 %"], "rate": [1.0, 1.0, None]}
    ]


def test_boxes_in_view() -> None:
    box = Box3D(np.array((0.0, 0.0, 2.0)), np.array((0.4, 0.2, 0.0)), np.eye(3))
    centred = box_surface(box)
    behind, aside, nothing = centred - np.array((0, 0, 4)), centred + np.array((5, 0, 0)), np.zeros((0, 3))
    found = boxes_in_view([centred, behind, aside, nothing], np.eye(4), CAMERA)
    np.testing.assert_allclose(found, [[40.5, 45.5, 20, 10]])
    assert boxes_in_view([], np.eye(4), CAMERA).shape == (0, 4)
    half_out = boxes_in_view([centred + np.array((0.97, 0, 0))], np.eye(4), CAMERA)
    np.testing.assert_allclose(half_out, [[89, 45.5, 11, 10]], atol=1.3)


def test_thinned_keeps_the_extremes() -> None:
    points = np.random.default_rng(0).normal(size=(9001, 3))
    few = thinned(points)
    assert len(few) <= 2007
    np.testing.assert_array_equal([few.min(axis=0), few.max(axis=0)], [points.min(axis=0), points.max(axis=0)])
    assert thinned(np.zeros((0, 3))).shape == (0, 3)


def test_split_instances() -> None:
    assert split_instances(np.zeros((0, 3), np.float32)) == []
    block = np.stack(np.meshgrid(*3 * [np.arange(0, 0.1, 0.01)]), axis=-1).reshape(-1, 3)
    crumb = np.array([[1.0, 1.0, 1.0]])
    parts = split_instances(np.concatenate((block[:500], crumb, block + 0.5)).astype(np.float32))
    assert [len(part) for part in parts] == [1000, 500]
    assert parts[1].tolist() == list(range(500))


def test_checksum_tells_data_apart(tmp_path: Path) -> None:
    first, copy = tmp_path / "first", tmp_path / "copy"
    for folder in (first, copy):
        (folder / "depth").mkdir(parents=True)
        (folder / "depth" / "0.png").write_bytes(b"depth")
    assert data_checksum(str(first)) == data_checksum(str(copy))
    (copy / "depth" / "0.png").write_bytes(b"other")
    assert data_checksum(str(first)) != data_checksum(str(copy))
    assert data_checksum("scene") == "built in"
