"""The colour camera's intrinsics and its pose relative to the depth camera, where the two are not registered."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from spot3d.camera import Intrinsics
from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import intrinsics_for
from spot3d.source.text_files import is_rigid, read_text

_APART_MOST_M = 1.0
"""Largest accepted distance between the cameras. Farther apart they do not share a view: the file is in millimetres."""

_FORMS = (
    'expected {"registered": true}, or {"colour": {"fx", "fy", "cx", "cy", "width", "height"}, "T_colour_depth": 4x4 '
    "rows} in pixels and metres"
)

Row = Annotated[list[float], Field(min_length=4, max_length=4)]


@dataclass(frozen=True, slots=True)
class ColourCamera:
    """Colour intrinsics, and T_colour_depth (4, 4) float64: depth camera points to colour camera points."""

    intrinsics: Intrinsics
    T_colour_depth: NDArray[np.float64]

    def averaged(self) -> "ColourCamera":
        """The camera of images that are downsampled by averaging whole blocks of 2 x 2 pixels."""
        full = self.intrinsics
        # A block's centre lies half a pixel beyond its first pixel's.
        centre = ((full.cx - 0.5) / 2, (full.cy - 0.5) / 2)
        half = Intrinsics(full.fx / 2, full.fy / 2, *centre, full.width // 2, full.height // 2)
        return ColourCamera(half, self.T_colour_depth)


# The Kinect of 7-Scenes. Depth intrinsics are those of the data set's page. Colour intrinsics and transform are from a
# calibration, checked by depth edges that fall on the objects' outlines in colour.
SEVEN_SCENES_DEPTH = Intrinsics(585.0, 585.0, 320.0, 240.0, 640, 480)
SEVEN_SCENES_COLOUR = ColourCamera(
    Intrinsics(525.0, 525.0, 320.0, 240.0, 640, 480),
    np.array(
        [
            [9.9996518012567637e-01, 2.6765126468950343e-03, -7.9041012313000904e-03, -2.5558943178152542e-02],
            [-2.7409311281316700e-03, 9.9996302803027592e-01, -8.1504520778013286e-03, 1.0109636268061706e-04],
            [7.8819942130445332e-03, 8.1718328771890631e-03, 9.9993554558014031e-01, 2.0318321729487039e-03],
            [0.0, 0.0, 0.0, 1.0],
        ]
    ),
)


class _ColourFile(BaseModel):
    model_config = ConfigDict(extra="forbid")
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class _CalibrationFile(BaseModel):
    model_config = ConfigDict(extra="forbid")
    registered: bool = False
    colour: _ColourFile | None = None
    T_colour_depth: Annotated[list[Row], Field(min_length=4, max_length=4)] | None = None


def load_calibration(folder: Path, depth: Intrinsics | None) -> ColourCamera | None:
    """The folder's colour camera, or None where colour is registered with depth already.

    `calibration.json` decides: `{"registered": true}`, or `{"colour": {"fx", "fy", "cx", "cy", "width", "height"},
    "T_colour_depth": 4x4 rows}` in pixels and metres. Without that file, `depth` intrinsics equal to those of
    7-Scenes' Kinect select its calibration. Raises SourceError if the file is malformed.
    """
    path = folder / "calibration.json"
    if not path.is_file():
        return SEVEN_SCENES_COLOUR if depth == SEVEN_SCENES_DEPTH else None
    try:
        entries = _CalibrationFile.model_validate(json.loads(read_text(path)))
        if entries.registered:
            return None
        if entries.colour is None or entries.T_colour_depth is None:
            raise ValueError('give "registered": true, or both "colour" and "T_colour_depth"')
        T_colour_depth = np.array(entries.T_colour_depth)
        if not is_rigid(T_colour_depth):
            raise ValueError(
                "T_colour_depth is not a rigid transform; give a rotation and a translation, with 0 0 0 1 as the "
                "last row"
            )
        if (apart_m := float(np.linalg.norm(T_colour_depth[:3, 3]))) > _APART_MOST_M:
            raise ValueError(f"T_colour_depth puts the cameras {apart_m:g} m apart; give the translation in metres")
        colour = entries.colour
        values = (colour.fx, colour.fy, colour.cx, colour.cy)
        return ColourCamera(intrinsics_for(values, (colour.height, colour.width), str(path)), T_colour_depth)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "the document"
        raise SourceError(f"{path} is malformed: {field}: {first['msg']}; {_FORMS}") from None
    except (ValueError, RecursionError) as error:
        raise SourceError(f"{path} is malformed: {error}") from None
