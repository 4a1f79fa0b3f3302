"""overview.png: the picture of the objects found."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.overview import draw_overview
from spot3d.drawing.picture import write_picture
from spot3d.frame import RgbdFrame
from spot3d.run.results import RunResult

View = tuple[RgbdFrame, NDArray[np.float64]]
"""A frame with its T_world_camera."""


def write_overview(
    path: Path, name: str, views: Sequence[View], result: RunResult, camera_path: NDArray[np.float64]
) -> str:
    """Draw the objects into views of the recording `name`, in its order, and from above. camera_path: (m, 3), world.

    Returns why it cannot be drawn, for people; otherwise empty. Raises OSError where the file cannot be written.
    """
    count = len(result.objects)
    title = f"spot3d    {name}    {count} object{'s' * (count != 1)} in {result.frame_count} frames"
    points, up = result.points, np.array(result.up)
    try:
        picture = draw_overview(title, views, result.objects, points.xyz, points.rgb, camera_path, up)
    except Exception as error:  # messages may hold any finite numbers, and the other results must not be lost
        return f"{path.name} cannot be drawn: {type(error).__name__}: {error}"
    write_picture(path, picture)
    return ""
