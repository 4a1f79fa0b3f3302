"""eps_min and eps_max of the paper: the sizes of objects for every stage, unless a stage has its own."""

from typing import Annotated

from pydantic import AfterValidator, Field, ValidationInfo

SIZE_MIN = 0.02
"""eps_min: an object is at least this large, metres."""
SIZE_MAX = 1.0
"""eps_max: an object is at most this large, metres."""


def _above_the_least(size_max: float, info: ValidationInfo) -> float:
    size_min = info.data.get("size_min", 0.0)
    if size_max <= size_min:
        raise ValueError(f"must be greater than size_min, which is {size_min:g} m")
    return size_max


SizeMax = Annotated[float, AfterValidator(_above_the_least), Field(validate_default=True)]
"""The setting `size_max` of a section, metres, which must be above its `size_min`."""
