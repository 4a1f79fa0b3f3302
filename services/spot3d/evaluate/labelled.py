"""Data sets for evaluation: single frames with true 2D boxes, sequences with true 3D boxes."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.evaluate.truth import LabelledScene
from spot3d.frame import RgbdFrame
from spot3d.source.sequence import FrameSequence


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """One frame and the (n, 4) float64 boxes [x, y, w, h] around its true objects, pixels.

    unjudged: (h, w) bool, pixels that are not annotated; None: all are annotated.
    """

    frame: RgbdFrame
    boxes: NDArray[np.float64]
    unjudged: NDArray[np.bool_] | None = None


Readers = tuple[Callable[[], LabelledFrame], ...]
"""What reads each of several frames when it is called."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledSequence:
    """A sequence with its scene's truth in the world of its true poses. Truth None: only poses can be compared."""

    name: str
    sequence: FrameSequence
    truth: LabelledScene | None


@dataclass(frozen=True, slots=True)
class DataSet:
    """What reads a data set's single frames, and its sequences. halved: they are at half size already."""

    name: str
    readers: Readers = ()
    sequences: tuple[LabelledSequence, ...] = ()
    halved: bool = False

    @property
    def frames(self) -> Iterator[LabelledFrame]:
        """The single frames, each read when it is its turn."""
        return (read() for read in self.readers)


def mask_boxes(instance: NDArray[np.integer], first: int, pixels_min: int = 1) -> NDArray[np.float64]:
    """Boxes (n, 4) [x, y, w, h] around the instances numbered `first` and up in an (h, w) mask.

    Instances of fewer than `pixels_min` pixels are left out.
    """
    parts = (np.nonzero(instance == number) for number in np.unique(instance[instance >= first]))
    return boxes_around(part for part in parts if len(part[0]) >= pixels_min)


def boxes_around(parts: Iterable[tuple[NDArray[np.integer], ...]]) -> NDArray[np.float64]:
    """Boxes (n, 4) [x, y, w, h] around parts of an image, each the rows (m,) and columns (m,) of its pixels."""
    boxes = [(u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1) for v, u in parts]
    return np.array(boxes, np.float64).reshape(-1, 4)
