"""An onlooker is sent no more than it looks at."""

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.run.one_sample import OneSample
from waiting import wait_until

WHERE = "one-sample/source/frame"


def test_after_the_first_sample_nothing_is_sent() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(connect=(endpoint,))
    with open_router((endpoint,)), open_session(link) as sending, open_session(link) as looking:
        publisher = sending.declare_publisher(WHERE)
        for first in (b"1", b"3"):
            look = OneSample(looking, WHERE)
            wait_until(lambda: publisher.matching_status.matching)
            publisher.put(first)
            # Nobody asks for the sample in between.
            wait_until(lambda: not publisher.matching_status.matching)
            publisher.put(b"2")
            assert look.sample is not None
            assert look.sample.payload.to_bytes() == first
            look.close()


def test_who_waits_no_longer_is_sent_nothing() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(connect=(endpoint,))
    with open_router((endpoint,)), open_session(link) as sending, open_session(link) as looking:
        publisher = sending.declare_publisher(WHERE)
        look = OneSample(looking, WHERE)
        wait_until(lambda: publisher.matching_status.matching)
        look.close()
        wait_until(lambda: not publisher.matching_status.matching)
        assert look.sample is None
