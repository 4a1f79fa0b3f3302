"""Text files of recordings, as other tools write them."""

from pathlib import Path

import numpy as np
import pytest

from spot3d.source.text_files import read_pose_matrix


@pytest.mark.parametrize(("begin", "between", "end"), [("", " ", ""), ("", ",", ""), ("[", ", ", "],")])
def test_a_pose_is_a_matrix_with_spaces_commas_or_brackets(begin: str, between: str, end: str, tmp_path: Path) -> None:
    T_world_camera = np.eye(4)
    T_world_camera[:3, 3] = 0.5, -1, 2
    rows = [begin + between.join(map(str, row)) + end for row in T_world_camera]
    path = tmp_path / "frame-000000.pose.txt"
    path.write_text("\n".join(rows))
    np.testing.assert_array_equal(read_pose_matrix(path), T_world_camera)
