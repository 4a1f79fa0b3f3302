"""One message of a topic and no more, for who looks at a stream of images now and then."""

from collections.abc import Callable
from contextlib import suppress

import zenoh


class OneSample:
    """The first message that comes, None before it. Subscribed until then: nobody sends what would not be looked at."""

    def __init__(self, session: zenoh.Session, where: str) -> None:
        self.sample: zenoh.Sample | None = None
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._subscriber = session.declare_subscriber(where, self._hear)
        if self.sample is not None:  # it came before there was a subscriber to close
            self.close()

    def close(self) -> None:
        """Listen no more."""
        subscriber, self._subscriber = self._subscriber, None
        if subscriber is not None:
            undeclare: Callable[[], object] = subscriber.undeclare
            with suppress(zenoh.ZError):  # its session may be closed, or two threads are here
                undeclare()

    def _hear(self, sample: zenoh.Sample) -> None:
        """In a thread of Zenoh's."""
        if self.sample is None:
            self.sample = sample
        self.close()
