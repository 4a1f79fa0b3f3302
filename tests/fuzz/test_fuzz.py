"""Mutated messages through the codec and through every stage: no crash, no hang, memory flat.

    make fuzz SECONDS=600

takes as long and says how much it did; without SPOT3D_FUZZ_SECONDS a small fixed number is tried, always the same.
"""

import os
import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mutation import Mutator
from real_messages import real_messages
from schemas_samples import SAMPLES
from stages_under_fire import rss_mb, under_fire

from spot3d_schemas import CodecError, Message, decode, encode

SECONDS = float(os.environ.get("SPOT3D_FUZZ_SECONDS", 0))
SEED = int(os.environ.get("SPOT3D_FUZZ_SEED", 1))
CODEC_SHARE = 0.25
"""Of the time; a message through the codec takes a hundredth of one through a stage."""
BATCH = 20
"""Captures between two looks whether all still work."""
GROWTH_MB = 150.0


def rounds(few: int, share: float) -> Iterator[int]:
    """`few` numbers, or as many as there is time for."""
    end_s = time.monotonic() + share * SECONDS
    number = 0
    while number < few or time.monotonic() < end_s:
        yield number
        number += 1


def decodes_or_refuses(payload: bytes, message: type[Message]) -> bool:
    """Whether it is accepted; what is accepted can be sent on."""
    try:
        encode(decode(payload, message))
    except CodecError:
        return False
    return True


def test_the_codec_refuses_or_understands(capsys: pytest.CaptureFixture[str]) -> None:
    messages = [*SAMPLES.values(), *real_messages("fuzz")[3].values()]
    payloads = [(type(message), encode(message)) for message in messages]
    assert all(decodes_or_refuses(payload, message) for message, payload in payloads)
    mutator, chance = Mutator(SEED), random.Random(SEED)
    before_mb, tried, understood = rss_mb(), 0, 0
    for tried in rounds(1500, CODEC_SHARE):
        message, payload = payloads[tried % len(payloads)]
        understood += decodes_or_refuses(mutator.mutated(payload, chance.choice((1, 1, 2, 4))), message)
    assert 0.05 < understood / tried < 0.95, "mutations neither all break a message nor leave it as it was"
    assert rss_mb() - before_mb < GROWTH_MB
    if SECONDS:
        with capsys.disabled():
            print(f"\ncodec: {tried + 1} messages, {understood} understood", end=" ")  # noqa: T201


# As in a stage's process: numbers that overflow there are no error, but must not harm.
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_every_stage_goes_on_after_whatever_it_was_sent(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    mutator, chance = Mutator(SEED), random.Random(SEED)
    with under_fire(tmp_path) as fired:
        fired.still_works()
        readings = []
        for number in rounds(3 * BATCH, 1 - CODEC_SHARE):
            fired.fire(mutator, chance)
            if number % BATCH == BATCH - 1:
                fired.ask(chance)
                fired.still_works()
                readings.append(rss_mb())
        sent = {stage.name: stage.sent for stage in fired.stages.values()}
        longest_s = max(stage.longest_s for stage in fired.stages.values())
    # The first third is for what fills up to its limit.
    settled = readings[len(readings) // 3]
    assert readings[-1] - settled < GROWTH_MB, f"memory grew: {[round(value) for value in readings]} MB"
    if SECONDS:
        with capsys.disabled():
            memory = f"{readings[0]:.0f}, {settled:.0f}, {readings[-1]:.0f} MB at its begin, a third and its end"
            print(f"\nstages: {sent} messages; slowest to answer {longest_s:.1f} s; memory {memory}", end=" ")  # noqa: T201
