"""Images over links that are too thin: as many as the link takes, evenly, and none of them waits."""

import random
from dataclasses import dataclass, field

import numpy as np
import pytest

from spot3d.bridge.pacing import Pacing

BYTES = 31_000
RATE_HZ = 30.0


@dataclass
class Link:
    """One queue with a rate, a way of 20 ms there and back each, and packets that TCP sends again."""

    mbit: float
    loss: float = 0.0
    free_s: float = 0.0
    echoes: list[tuple[float, int]] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(1))

    def echo_s(self, now_s: float) -> float:
        """When the sender hears that an image that it sends now has arrived."""
        self.free_s = max(self.free_s, now_s) + BYTES * 8 / (self.mbit * 1e6)
        # One of the image's 22 packets is lost: its repetition takes a way there and back and some.
        again = 0.06 if self.rng.random() < 1 - (1 - self.loss) ** 22 else 0.0
        return self.free_s + 0.04 + again


@dataclass
class Sent:
    at_s: list[float] = field(default_factory=list)
    delay_s: list[float] = field(default_factory=list)


def play(pacing: Pacing, link: Link, seconds: float, start_s: float = 0.0, jitter_s: float = 0.003) -> Sent:
    """Offer images at 30 a second."""
    done, echoes = Sent(), link.echoes
    jitter = random.Random(2)
    for number in range(int(seconds * RATE_HZ)):
        now_s = start_s + number / RATE_HZ + jitter.uniform(0, jitter_s)
        while echoes and echoes[0][0] <= now_s:
            at_s, image = echoes.pop(0)
            pacing.arrived(image, at_s)
        if pacing.may_send(now_s):
            image, at_s = pacing.sent(now_s), link.echo_s(now_s)
            echoes.append((at_s, image))
            echoes.sort()
            done.at_s.append(now_s)
            done.delay_s.append(at_s - now_s)
    return done


@pytest.mark.parametrize(("mbit", "loss"), [(20, 0.0), (20, 0.01), (12, 0.0)])
def test_a_link_that_takes_all_gets_nearly_all(mbit: float, loss: float) -> None:
    done = play(Pacing(), Link(mbit, loss), 30)
    assert len(done.at_s) > 0.95 * 30 * RATE_HZ


@pytest.mark.parametrize("mbit", [1.0, 2.0, 4.0, 6.0])
def test_a_thin_link_is_used_without_a_queue(mbit: float) -> None:
    done = play(Pacing(), Link(mbit), 60)
    settled = np.searchsorted(done.at_s, 10)
    at_s, delay_s = np.array(done.at_s[settled:]), np.array(done.delay_s[settled:])
    takes = mbit * 1e6 / 8 / BYTES
    assert 0.75 * takes < len(at_s) / 50 < 1.02 * takes
    alone_s = 0.04 + 1 / takes
    assert np.quantile(delay_s, 0.95) < alone_s + max(0.1, 1 / takes)
    gaps = np.diff(at_s)
    # Even: images come in a raster of 33 ms, and once in ten seconds one travels alone.
    assert np.quantile(gaps, 0.95) < 1.5 * gaps.mean() + 1 / RATE_HZ


def test_a_link_that_becomes_thin_and_wide_again() -> None:
    pacing, link = Pacing(), Link(20)
    play(pacing, link, 10)
    link.mbit = 3
    thin = play(pacing, link, 20, 10)
    link.mbit = 20
    wide = play(pacing, link, 20, 30)
    after = np.searchsorted(thin.at_s, 15)
    assert np.quantile(thin.delay_s[after:], 0.9) < 0.25
    assert np.count_nonzero(np.array(wide.at_s) > 35) > 0.95 * 15 * RATE_HZ


def test_a_longer_way_is_no_queue_for_long() -> None:
    pacing, link = Pacing(), Link(20)
    play(pacing, link, 10)
    way = link.echo_s
    link.echo_s = lambda now_s: way(now_s) + 0.2  # type: ignore[method-assign]
    longer = play(pacing, link, 60, 10)
    assert np.count_nonzero(np.array(longer.at_s) > 60) > 0.8 * 10 * RATE_HZ


def test_nothing_piles_up_while_the_link_is_gone() -> None:
    pacing = Pacing()
    play(pacing, Link(20), 5)
    gone = [now_s for now_s in 5 + np.arange(90) / RATE_HZ if pacing.may_send(now_s) and pacing.sent(now_s)]
    assert len(gone) <= 8
    back = play(Pacing(), Link(20), 5, 8)  # each connection has its own
    assert back.at_s[0] < 8.05
    assert len(back.at_s) > 0.9 * 5 * RATE_HZ
