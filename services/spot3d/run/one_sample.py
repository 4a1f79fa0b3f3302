"""A subscription for one message, for those who look at a stream of images now and then."""

import zenoh

from spot3d.dataflow.endpoints import end_subscription


class OneSample:
    """The first message, or None until it comes. It then unsubscribes: nobody sends images that are not looked at."""

    def __init__(self, session: zenoh.Session, where: str) -> None:
        self.sample: zenoh.Sample | None = None
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._subscriber = session.declare_subscriber(where, self._hear)
        if self.sample is not None:  # it came before `_subscriber` was set
            self.close()

    def close(self) -> None:
        """Unsubscribe."""
        subscriber, self._subscriber = self._subscriber, None
        if subscriber is not None:
            end_subscription(subscriber)

    def _hear(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh's."""
        if self.sample is None:
            self.sample = sample
        self.close()
