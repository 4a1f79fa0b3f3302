"""A ROS bag of version 1 or 2: its topics, and their messages, read on access."""

import logging
import struct
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.recorder.profile import mcap_profile
from spot3d.source.errors import SourceError

log = logging.getLogger(__name__)

_READ_ON = 32
"""Messages up to this far ahead are reached by reading on, farther ones by the bag's index."""
_STAMPED_BYTES = 12
"""Bytes of a message up to the end of its stamp, in either version."""


def is_ros_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a `.bag`, `.db3` or `.mcap` file, or the folder of a ROS 2 bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() and any(path.glob("*.db3*")) | any(path.glob("*.mcap*"))
    return path.suffix in (".bag", ".db3", ".mcap") and path.is_file()


class Bag:
    """An open bag. Its methods, too, raise SourceError for data that cannot be read."""

    def __init__(self, path: Path) -> None:
        if path.suffix == ".mcap" and (profile := mcap_profile(path)) != "ros2":
            if profile is None:
                raise SourceError(f"{path} is not an MCAP file; is the recording complete?")
            raise SourceError(
                f"{path} is an MCAP file, but not a ROS 2 bag: its profile is {profile!r}, not 'ros2'"
                + ("; convert it to .bag, or record with ROS 2" if profile == "ros1" else "")
            )
        self.path = path
        with _told(path):
            self._reader = _opened_for(self, path)
        self.types: dict[str, str] = {one.topic: one.msgtype for one in self._reader.connections}
        """Message type of each topic, as `sensor_msgs/msg/Image` for either version."""

    def messages(self, *topics: str) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of receipt in ns, and message, for all messages of the topics in the order of receipt.

        Messages that cannot be decoded are skipped and logged.
        """
        refused: list[SourceError] = []
        for topic, received_ns, raw in self._raw(topics):
            try:
                message = self.decoded(topic, raw)
            except SourceError as error:
                refused.append(error)
                continue
            yield topic, received_ns, message
        if refused:
            log.warning(
                "%d messages of %s are left out; the first error: %s", len(refused), ", ".join(topics), refused[0]
            )

    def stamps(self, *topics: str) -> "dict[str, BagTopic]":
        """Indexes the messages of the topics in one pass through the bag. Their types must begin with a header."""
        times: dict[str, list[tuple[int, int]]] = {topic: [] for topic in topics}
        for topic, received_ns, raw in self._raw(topics):
            times[topic].append((received_ns, self._header_stamp(raw)))
        return {topic: BagTopic(self, topic, np.array(rows).reshape(-1, 2)) for topic, rows in times.items()}

    def decoded(self, topic: str, raw: bytes) -> Any:
        """Decodes the bytes of a topic's message."""
        with _told(self.path):
            return self._reader.deserialize(raw, self.types[topic])

    def _raw(self, topics: tuple[str, ...]) -> Iterator[tuple[str, int, bytes]]:
        connections = [one for one in self._reader.connections if one.topic in topics]
        with _told(self.path):
            for connection, received_ns, raw in self._reader.messages(connections) if connections else ():
                yield connection.topic, received_ns, raw

    def _header_stamp(self, raw: bytes) -> int:
        """The stamp of the std_msgs/Header that begins a message, ns. 0 if the message is too short."""
        if len(raw) < _STAMPED_BYTES:
            return 0
        if self._reader.is2:  # after four bytes that state the encoding
            seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
        else:  # after the sequence number
            seconds, nanoseconds = struct.unpack_from("<II", raw, 4)
        return int(seconds) * 10**9 + int(nanoseconds)


class BagTopic:
    """One topic's messages by index, in the order of receipt. Consecutive messages are read sequentially.

    times_ns: (n, 2) int64, time of receipt and header stamp. `stamps_ns`: (n,) int64, the header stamp, or the time of
    receipt of a message without one.
    """

    def __init__(self, bag: Bag, topic: str, times_ns: NDArray[np.int64]) -> None:
        self.name = topic
        self._received_ns = times_ns[:, 0]
        stamped = times_ns[:, 1] > 0
        self.stamps_ns = np.where(stamped, times_ns[:, 1], times_ns[:, 0])
        if not stamped.all():
            count = np.count_nonzero(~stamped)
            told = "have no timestamp: their time of receipt is used"
            log.warning("%s: %d of %d messages %s", topic, count, len(stamped), told)
        self._bag = bag
        # A reader for each topic: with one for all, ROS 1 unpacks a chunk anew at each change of topic.
        self._reader: Any | None = None
        self._next = 0
        self._messages: Iterator[tuple[Any, int, bytes]] = iter(())

    def __len__(self) -> int:
        return len(self._received_ns)

    def __getitem__(self, index: int) -> Any:
        """One message. Raises SourceError."""
        with _told(self._bag.path):
            if self._reader is None or not self._next <= index < self._next + _READ_ON:
                self._go_to(index)
            for _ in range(index - self._next):
                next(self._messages)
            raw = next(self._messages)[2]
            self._next = index + 1
        return self._bag.decoded(self.name, raw)

    def _go_to(self, index: int) -> None:
        if self._reader is None:
            self._reader = _opened_for(self, self._bag.path)
        start = int(self._received_ns[index])
        connections = [one for one in self._reader.connections if one.topic == self.name]
        self._messages = self._reader.messages(connections, start=start)
        self._next = int(np.searchsorted(self._received_ns, start))


def _opened_for(owner: object, path: Path) -> Any:
    """A reader that is closed when its owner is deleted."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError:
        raise SourceError("reading ROS bags needs rosbags, which is not installed: pip install 'spot3d[ros]'") from None
    # Bags of ROS 2 before Iron do not include their message definitions.
    reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
    reader.open()
    weakref.finalize(owner, reader.close)
    return reader


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turns any error of a damaged bag into a SourceError that names the bag."""
    try:
        yield
    except (SourceError, GeneratorExit):
        raise
    except Exception as error:
        text = str(error) or type(error).__name__
        raise SourceError(
            f"{path} cannot be read as a ROS bag: {text}; check that it is complete, or reindex it"
        ) from error
