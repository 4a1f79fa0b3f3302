"""One message of a topic and no more, for who looks at a stream of images now and then."""

import zenoh

from spot3d.dataflow.endpoints import end_subscription


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
            end_subscription(subscriber)

    def _hear(self, sample: zenoh.Sample) -> None:
        """In a thread of Zenoh's."""
        if self.sample is None:
            self.sample = sample
        self.close()
