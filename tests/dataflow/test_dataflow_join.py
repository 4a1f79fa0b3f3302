"""The join gives every stamp exactly once, in bounded memory."""

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot3d.dataflow.join import Join, images_waiting
from spot3d.dataflow.node import Received
from spot3d.dataflow.settings import LinkSettings

S = 1_000_000_000
NOTED = {"no left": "{}-", "no right": "-{}"}


def message(stamp: int) -> SimpleNamespace:
    return SimpleNamespace(header=SimpleNamespace(stamp_ns=stamp))


def feed(join: Join[Any, Any], items: str) -> list[str]:
    """Feed items such as `L3 R3`; returns what came of them: `3` a pair, `-3` without right, `3-` without left."""
    out = []
    for item in items.split():
        side, stamp = item[0], int(item[1:])
        given = Received(message(stamp), 0)
        outcome = (join.add_left if side == "L" else join.add_right)(given)
        out += [NOTED[skipped.reason].format(skipped.stamp_ns) for skipped in outcome.skipped]
        if outcome.pair is not None:
            assert [half.message.header.stamp_ns for half in outcome.pair] == [stamp, stamp]
            assert outcome.pair["LR".index(side)] is given
            out.append(str(stamp))
    return out


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ("", []),
        ("L1", []),
        ("L1 R1 R2 L2", ["1", "2"]),
        ("R1 R2 L1 L2", ["1", "2"]),
        ("R1 R2 R3 L1 L2 L3", ["1-", "2", "3"]),  # two wait at most
        ("L1 L2 R2", ["-1", "2"]),  # the right stream has passed 1
        ("R1 R2 L2", ["1-", "2"]),
        ("R2 L1 L2", ["-1", "2"]),  # known at once, without waiting for room
        ("L1 R2 L3 R3", ["-1", "2-", "3"]),
        ("L1 L2 L3 L4 R1", ["-1", "-2"]),
        ("L4 R1 R2 R3 R4", ["1-", "2-", "3-", "4"]),
    ],
)
def test_outcomes(items: str, expected: list[str]) -> None:
    assert feed(Join(2, 2, *NOTED), items) == expected


def test_another_recording_begins() -> None:
    join: Join[Any, Any] = Join(9, 9, *NOTED)
    old, new = 5 * S, S
    assert feed(join, f"L{old} R{old} L{old + 1} R{old + 2}") == [f"{old}", f"-{old + 1}"]
    # The right stream goes first; what it left over of the old recording goes.
    assert feed(join, f"R{new} R{new + 1}") == [f"{old + 2}-"]
    assert feed(join, f"L{new} L{new + 1}") == [f"{new}", f"{new + 1}"]


def test_clear() -> None:
    join: Join[Any, Any] = Join(2, 2, *NOTED)
    assert feed(join, "L1 R3") == ["-1"]
    join.clear()
    assert feed(join, "R1 L1") == ["1"]


@given(
    st.sets(st.integers(0, 30)),
    st.sets(st.integers(0, 30)),
    st.lists(st.booleans(), min_size=60, max_size=60),
    st.integers(1, 4),
)
def test_every_stamp_comes_out_once(left: set[int], right: set[int], turns: list[bool], size: int) -> None:
    lefts, rights = sorted(left), sorted(right)
    join: Join[Any, Any] = Join(size, size, *NOTED)
    out: list[str] = []
    for turn in [*turns, *[True, False] * 60]:
        if not (lefts or rights):
            break
        from_left = bool(lefts) and (turn or not rights)
        out += feed(join, f"L{lefts.pop(0)}" if from_left else f"R{rights.pop(0)}")
    out += feed(join, "L99 R99")
    stamps = [int(item.strip("-")) for item in out]
    assert sorted(stamps) == sorted(left | right | {99})
    assert {int(item) for item in out if "-" not in item} <= (left & right) | {99}


@pytest.mark.parametrize(
    ("delivery", "in_flight", "most"), [("live", 4, 16), ("live", 64, 16), ("lossless", 4, 16), ("lossless", 64, 128)]
)
def test_only_a_lossless_run_has_as_many_images_wait_as_are_on_their_way(
    delivery: str, in_flight: int, most: int
) -> None:
    assert images_waiting(16, LinkSettings(delivery=delivery, in_flight=in_flight)) == most
