"""Frames for a thin link: no more samples than segments and fusion use, and depth no finer than the sensor's noise."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.dataflow.settings import LinkSettings
from spot3d.depth_noise import DepthNoise
from spot3d.frame import RgbdFrame
from spot3d.geometry.downsampling import to_lattice

_FARTHEST, _GRID = 32.0, 0.001
"""Noise is summed up to this range in steps of a millimetre, metres; farther depth stays as it is."""
_PAYS = 0.75
"""Rounding that leaves this share of the distinct values or more saves too little to be used."""


DepthImage = NDArray[np.uint16] | NDArray[np.float32]


def thinned(frame: RgbdFrame, heat: NDArray[np.uint8], link: LinkSettings) -> tuple[RgbdFrame, NDArray[np.uint8]]:
    """A frame and its heat (h, w) uint8, reduced to the lattice of `link.thin_width` and rounded as `link` says."""
    small = to_lattice(frame.colour, frame.depth_metres(), heat, frame.intrinsics, link.thin_width)
    if small.camera != frame.intrinsics:
        frame = replace(frame, colour=small.colour, depth=small.depth, depth_scale=1.0, intrinsics=small.camera)
        heat = small.heat
    if link.thin_depth_share > 0:
        noise = frame.intrinsics.noise
        rounded = rounded_depth(frame.depth, frame.depth_scale, link.thin_depth_share, noise)
        # Depth that a sensor gives in steps as coarse costs no more unrounded.
        if _values(rounded) < _PAYS * _values(frame.depth):
            frame = replace(frame, depth=rounded)
    return frame, rounded_heat(heat, link.thin_heat_levels)


def rounded_depth(depth: DepthImage, depth_scale: float, share: float, noise: DepthNoise) -> DepthImage:
    """Depth rounded to steps of `share` of its `noise`, which leaves few distinct values.

    depth: (h, w) uint16 in units of `depth_scale` metres, or float32 metres; 0 = invalid stays 0. It moves by half a
    step at most (and half a unit). Rounding adds share² / 12 to the noise's variance: for a half 2 %, 1 % of sigma.
    """
    if depth.dtype == np.uint16:
        return _table(depth_scale, share, noise)[depth]
    return _rounded(depth, share, noise).astype(np.float32)


def rounded_heat(heat: NDArray[np.uint8], levels: int) -> NDArray[np.uint8]:
    """(h, w) uint8 heat on `levels` evenly spaced values from 0 to 255; it moves by half a step at most."""
    step = 255 / (levels - 1)
    table = np.rint(np.rint(np.arange(256) / step) * step).astype(np.uint8)
    return np.asarray(table[heat])


def _values(depth: DepthImage) -> int:
    """How many distinct values there are."""
    return int(np.count_nonzero(np.bincount(depth.ravel())) if depth.dtype == np.uint16 else len(np.unique(depth)))


@lru_cache(maxsize=8)
def _table(depth_scale: float, share: float, noise: DepthNoise) -> NDArray[np.uint16]:
    """The rounded depth of every uint16 depth, in the same units."""
    units = np.arange(2**16)
    rounded = np.rint(_rounded(units * depth_scale, share, noise) / depth_scale)
    return np.where(units > 0, np.clip(rounded, 1, 2**16 - 1), 0).astype(np.uint16)


def _rounded(metres: NDArray[Any], share: float, noise: DepthNoise) -> NDArray[np.float64]:
    grid, steps = _scale(share, noise)
    near = (metres > 0) & (metres < _FARTHEST)
    return np.where(near, np.interp(np.rint(np.interp(metres, grid, steps)), steps, grid), metres)


@lru_cache(maxsize=8)
def _scale(share: float, noise: DepthNoise) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ranges, metres, and how many steps of `share` of the noise lie below each."""
    grid = np.arange(0, _FARTHEST + _GRID, _GRID)
    density = 1 / (share * noise.sigma(grid))
    return grid, np.concatenate(([0.0], np.cumsum((density[1:] + density[:-1]) / 2 * _GRID)))
