"""The code for images of few distinct values: lossless, small, and refused where it is malformed."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spot3d_schemas.array_codes import delta_zlib_encode
from spot3d_schemas.arrays import DELTA_ZLIB, PALETTE, encode_data
from spot3d_schemas.limits import MAX_IMAGE_PIXELS
from spot3d_schemas.palette_code import MOST_VALUES, ManyValuesError, palette_decode, palette_encode

VALUES = {
    np.uint8: st.integers(0, 255),
    np.uint16: st.sampled_from([0, 1, 800, 803, 2**16 - 1]) | st.integers(0, 2**16 - 1),
    np.float32: st.sampled_from([0.0, -0.0, np.inf, np.nan, 1e-40]) | st.floats(width=32),
}
SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 19))


def decoded(code: bytes, image: np.ndarray, plane: bool) -> np.ndarray:
    return palette_decode(memoryview(code), image.dtype.newbyteorder("<"), image.shape, plane)


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("dtype", list(VALUES))
@settings(derandomize=True, deadline=None, max_examples=60)
@given(data=st.data())
def test_every_image_comes_back_to_the_bit(dtype: type, plane: bool, data: st.DataObject) -> None:
    image = data.draw(arrays(dtype, SHAPES, elements=VALUES[dtype]))
    back = decoded(palette_encode(image, plane), image, plane)
    assert (back.dtype, back.shape, back.tobytes()) == (image.dtype, image.shape, image.tobytes())


@pytest.mark.parametrize("plane", [False, True])
def test_the_widest_steps_between_the_most_values(plane: bool) -> None:
    ranks = np.random.default_rng(0).integers(0, MOST_VALUES, (64, 1024)).astype(np.uint16)
    ranks[::2, ::2], ranks[::2, 1::2] = 0, MOST_VALUES - 1
    image = 2 * ranks
    assert np.array_equal(decoded(palette_encode(image, plane), image, plane), image)


def test_an_image_of_more_values_travels_in_another_code() -> None:
    image = np.arange(MOST_VALUES + 1, dtype=np.uint16)[None]
    with pytest.raises(ManyValuesError, match="32769 distinct values"):
        palette_encode(image, plane=False)
    assert encode_data(image, (PALETTE, DELTA_ZLIB), 90)[0] == DELTA_ZLIB


def test_depth_in_a_sensors_own_steps_takes_half() -> None:
    """A slanted floor as a disparity sensor measures it, with holes: 38 mm apart at 3.6 m, 2 mm at 0.8 m."""
    rng = np.random.default_rng(0)
    disparity = np.linspace(160, 720, 240)[:, None] + rng.normal(0, 0.3, (240, 320))
    depth = np.rint(575_000 / np.rint(disparity)).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.05] = 0
    assert len(palette_encode(depth, plane=False)) < 0.6 * len(delta_zlib_encode(depth))


def stream(values: bytes, mask: bytes, small: bytes, escapes: bytes = b"", n: int = 2, m: int | None = None) -> bytes:
    head = struct.pack("<II", n, len(escapes) // 2 if m is None else m)
    return zlib.compress(head + values + mask + small + escapes)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (b"", "is not an image"),
        (b"no deflate stream", "damaged"),
        (stream(b"\0\5", b"\xc0", b"\x22")[:-5], "is not an image"),
        (zlib.compress(b"\1\0\0"), "is not an image"),
        (stream(b"", b"\xc0", b"\x22", n=0), "the parts of the palette do not form"),
        (stream(b"\0\5", b"\xc0", b"\x22", n=2**31), "the parts of the palette do not form"),
        (stream(b"\0\5", b"\xc0", b"\x22\0"), "the parts of the palette do not form"),
        (stream(b"\0\5", b"\xc0", b"\x22", m=2**32 - 1), "the parts of the palette do not form"),
        (stream(b"\0\5", b"\xc0", b"\x2f"), "escapes"),
        (stream(b"\0\5", b"\xc0", b"\x22", b"\1\0"), "escapes"),
        (stream(b"\0\5", b"\xc0", b"\x22"), "refers to value 2"),
        (stream(b"\0\5", b"\xc0", b"\x11"), "refers to value 65535"),
    ],
)
def test_malformed_codes_are_refused(code: bytes, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        palette_decode(memoryview(code), np.dtype("<u1"), (1, 3), plane=False)


@pytest.mark.parametrize(("shape", "budget"), [((4, 6), 200_000), ((2048, 2048), 12 * MAX_IMAGE_PIXELS)])
def test_a_deflate_bomb_is_cut_at_what_the_shape_can_take(shape: tuple[int, int], budget: int) -> None:
    bomb = memoryview(zlib.compress(bytes(100_000_000), 9))
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="is not an image"):
            palette_decode(bomb, np.dtype("<u2"), shape, plane=True)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < budget
