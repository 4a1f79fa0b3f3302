"""Text files of recordings, as other tools write them."""

from pathlib import Path

import numpy as np
import pytest

from spot3d.source.errors import SourceError
from spot3d.source.text_files import read_pose_matrix, read_stamped_lines, read_text


@pytest.mark.parametrize(("begin", "between", "end"), [("", " ", ""), ("", ",", ""), ("[", ", ", "],")])
def test_a_pose_is_a_matrix_with_spaces_commas_or_brackets(begin: str, between: str, end: str, tmp_path: Path) -> None:
    T_world_camera = np.eye(4)
    T_world_camera[:3, 3] = 0.5, -1, 2
    rows = [begin + between.join(map(str, row)) + end for row in T_world_camera]
    path = tmp_path / "frame-000000.pose.txt"
    path.write_text("\n".join(rows))
    np.testing.assert_array_equal(read_pose_matrix(path), T_world_camera)


@pytest.mark.parametrize("stamp", ["1341841278000000000", "1341841278000.125", "1.341841278e12", "-99999999999"])
def test_a_stamp_that_is_too_large_for_seconds_may_be_in_another_unit(stamp: str, tmp_path: Path) -> None:
    path = tmp_path / "depth.txt"
    path.write_text(f"{stamp} depth/1.png\n")
    with pytest.raises(SourceError, match=r"not with '.*'; is it in another unit, such as nanoseconds\?$"):
        read_stamped_lines(path, lambda words, _where: words)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_a_file_in_another_encoding_is_refused_with_what_to_do(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "depth.txt"
    path.write_text("# K\u00fcche\n1.0 depth/1.png\n", encoding=encoding)
    with pytest.raises(SourceError, match=r"depth\.txt is not a text file in UTF-8: .*; save it as UTF-8$"):
        read_text(path)
