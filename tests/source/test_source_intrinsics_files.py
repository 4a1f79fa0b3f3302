"""Intrinsics of options and of files of a recording."""

import pytest

from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import intrinsics_for, parse_intrinsics


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
    said = f"--intrinsics: focal lengths must be positive and all values finite, in pixels, got {given}"
    assert str(refused.value) == said
