"""Intrinsics of options and of files of a recording."""

from collections.abc import Callable
from pathlib import Path

import pytest

from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import (
    FocalAndCentre,
    intrinsics_for,
    parse_intrinsics,
    seven_scenes_values,
    tum_values,
)

FOLDERS = [("camera-intrinsics.txt", seven_scenes_values), ("intrinsics.txt", tum_values)]


@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("0,0,0,0", "fx 0, fy 0, cx 0, cy 0"),
        ("nan,-585,320,240", "fx nan, fy -585, cx 320, cy 240"),
        ("585,585,inf,240", "fx 585, fy 585, cx inf, cy 240"),
    ],
)
def test_values_that_no_camera_has_are_refused_in_words(text: str, given: str) -> None:
    with pytest.raises(SourceError) as refused:
        intrinsics_for(parse_intrinsics(text), (480, 640), "--intrinsics")
    said = f"--intrinsics: focal lengths must be positive and all values finite, in pixels; got {given}"
    assert str(refused.value) == said


@pytest.mark.parametrize(("name", "values"), FOLDERS)
@pytest.mark.parametrize(
    "text",
    [
        "520.5 521 320 240\n",
        "# fx fy cx cy\n520.5, 521, 320, 240",
        "520.5 0 320\n0 521 240\n0 0 1\n",
        "520.5,0,320\n0,521,240\n0,0,1\n",
        "[[520.5, 0, 320], [0, 521, 240], [0, 0, 1]]\n",
        "[[520.5 0. 320.]\n [0. 521. 240.]\n [0. 0. 1.]]",
    ],
)
def test_either_layout_takes_four_numbers_or_a_matrix(
    name: str, values: Callable[[Path], FocalAndCentre], text: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    assert values(tmp_path) == (520.5, 521, 320, 240)


@pytest.mark.parametrize(("name", "values"), FOLDERS)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it has 0 numbers; expected fx fy cx cy, or"),
        ("520 521 320 240 0.1", "it has 5 numbers; expected"),
        ("fx 520", "it contains text that is not a number; expected"),
        ("520 3 320 0 520 240 0 0 1", r"expected fx fy cx cy, or \[\[fx, 0, cx\], \[0, fy, cy\]"),
        ("520 0 320 0 520 240 0 0 7", "expected"),
    ],
)
def test_either_layout_says_what_it_takes(
    name: str, values: Callable[[Path], FocalAndCentre], text: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(SourceError, match=f"/{name} is malformed: {said}"):
        values(tmp_path)
