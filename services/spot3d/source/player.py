"""Plays a recording or a camera's stream once: sends its frames in order, paced and counted, and then its end."""

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass

from pydantic import ValidationError

from spot3d.dataflow.conversion import frame_message
from spot3d.dataflow.credit import Credit
from spot3d.dataflow.node import Node
from spot3d.dataflow.order import StreamOrder
from spot3d.dataflow.pace import Pace
from spot3d.dataflow.previews import Previews
from spot3d.dataflow.streams import new_stream
from spot3d.frame import RgbdFrame
from spot3d.source.errors import BETWEEN_STREAMS, IN_THE_INPUT, UNREADABLE, UNSENDABLE, WITHOUT_POSE
from spot3d.source.image_limit import refuse_large_images
from spot3d.source.sequence import CAMERA_GONE, FrameSequence, FrameStream
from spot3d.source.settings import SourceSettings
from spot3d_schemas import STAGES, End, Header, Progress
from spot3d_schemas.codec import first_problem

log = logging.getLogger(__name__)

OUT, END, PREVIEW = "source/frame", "source/end", "source/preview"
_END_LIMIT_S = 60.0
"""Longest wait for fusion to confirm the end."""
_END_INTERVAL_S = 0.5
_DONE = object()


@dataclass(frozen=True, slots=True)
class Sent:
    """What an earlier process has sent of a stream: how many frames, and the last stamp."""

    frames: int = 0
    stamp_ns: int = 0


class Player:
    """One pass through a sequence.

    sent: frames that this process has sent; in_stream: frames of the stream, with those that an earlier one has sent.
    """

    def __init__(self, node: Node, stream: str, settings: SourceSettings, earlier: Sent) -> None:
        self.node, self.stream, self.settings = node, stream, settings
        self.credit = Credit(node.link.in_flight)
        self.previews = Previews(node, PREVIEW)
        self.order = StreamOrder()
        self.sent, self.in_stream = 0, earlier.frames
        self.last_stamp_ns = earlier.stamp_ns
        self.leaving: Iterator[None] | None = None

    def play(self, sequence: FrameSequence | FrameStream, rate_hz: float | None) -> None:
        """Publish the frames and then the stream's end.

        rate_hz: frames per second; None: the recorded pace in a live run, and none in a lossless one.
        """
        lossless, is_camera = self.node.link.delivery == "lossless", isinstance(sequence, FrameStream)
        # A camera's clock may be set while it streams.
        self.order = StreamOrder(confirm=is_camera or not lossless)
        # A camera has a pace of its own. At a given rate, each frame counts as a recorded second.
        paced = not is_camera and (rate_hz is not None or not lossless)
        pace, first_ns = Pace(rate_hz or 1.0, self.node.note), 0
        for frame, read_ns in self._streamed(sequence) if isinstance(sequence, FrameStream) else self._frames(sequence):
            if not self._in_order(frame.stamp_ns):
                continue
            if self.sent == 0:
                pace.restart()
                first_ns = frame.stamp_ns
            if paced:
                recorded_s = 1e-9 * (frame.stamp_ns - first_ns) if rate_hz is None else float(self.sent)
                pace.wait(recorded_s, self.node.stop, self.node.rest)
            if lossless:
                self._wait_for_credit(self.credit.in_flight - 1)
            else:
                self._read_progress(0.0)
            if self.node.stop.is_set():
                return
            self._send(frame, read_ns)
        if lossless:
            self._wait_for_credit(0)
        for _ in self._ending(_END_INTERVAL_S):
            pass

    def _frames(self, sequence: FrameSequence) -> Iterator[tuple[RgbdFrame, int]]:
        """The readable frames, each with the wall clock (ns) before it was read."""
        # Looked up once: without poses, the whole recording is searched.
        has_true_poses = sequence.has_true_poses
        for index in range(len(sequence)):
            if self.node.stop.is_set():
                return
            read_ns, start_s = time.time_ns(), time.perf_counter()
            try:
                frame = sequence[index]
            except Exception as error:
                self.node.crashed("source", f"frame {index} cannot be read", error)
                self.node.counters.drop(UNREADABLE)
                continue
            self.node.counters.step(time.perf_counter() - start_s)
            if has_true_poses and frame.T_world_camera is None:
                self.node.counters.event(WITHOUT_POSE)
            yield frame, read_ns

    def _streamed(self, camera: FrameStream) -> Iterator[tuple[RgbdFrame, int]]:
        """A camera's frames, each with the wall clock (ns) at its arrival."""
        for frame in camera.stream(self.node.stop, self._camera_said):
            if frame is None:
                # Taking messages keeps the heartbeat alive while there is no frame.
                if self.leaving is None:
                    self._read_progress(0.0)
                else:
                    self._leave(self.leaving)
                continue
            refuse_large_images(frame.intrinsics, self.settings.halved)
            self.node.state = ""
            yield frame, time.time_ns()

    def _camera_said(self, kind: str, text: str) -> None:
        self.node.note(kind, text)
        if kind in CAMERA_GONE:
            self.node.state = text

    def _in_order(self, stamp_ns: int) -> bool:
        """Whether to send the frame. A camera's stamps that go back for good start another stream."""
        try:
            header = self._header(stamp_ns)
        except ValueError as error:
            self._unsendable(stamp_ns, error)
            return False
        arrival = self.order.check(header, time.monotonic())
        if arrival.refused:
            self.node.counters.drop(f"{arrival.refused} {IN_THE_INPUT}")
            return False
        if arrival.restarted and self.leaving is None:
            self.node.note(
                "streams", "the camera's timestamps went back: a new stream begins when this one is complete"
            )
            if self.node.link.delivery == "lossless":
                self._wait_for_credit(0)
            self.leaving = self._ending(0.0)
        if self.leaving is None or self._leave(self.leaving):
            return True
        self.node.counters.drop(BETWEEN_STREAMS)
        return False

    def _leave(self, leaving: Iterator[None]) -> bool:
        """Whether the old stream is complete. If so, starts a new one, for which fusion starts a new map."""
        if self.in_stream and next(leaving, _DONE) is not _DONE:
            return False
        self.leaving, self.stream, self.in_stream = None, new_stream(), 0
        return True

    def _header(self, stamp_ns: int) -> Header:
        return Header(robot=self.node.link.robot, seq=0, stamp_ns=stamp_ns, frame_id="camera", stream=self.stream)

    def _send(self, frame: RgbdFrame, read_ns: int) -> None:
        header = self._header(frame.stamp_ns)
        try:
            message = frame_message(header.with_hop("source", read_ns, time.time_ns()), frame)
        except ValueError as error:
            self._unsendable(frame.stamp_ns, error)
            return
        # Numbered last: subscribers count missing numbers as lost messages.
        message = message.model_copy(update={"header": self.node.numbered(OUT, message.header)})
        if self.node.link.delivery == "lossless":
            self.credit.sent(frame.stamp_ns)
        self.node.publish(OUT, message)
        self.previews.offer(message.header, frame.colour, frame.intrinsics)
        self.sent += 1
        self.in_stream += 1
        self.last_stamp_ns = frame.stamp_ns

    def _unsendable(self, stamp_ns: int, error: ValueError) -> None:
        """Count a frame that no message can hold, and report why."""
        what = f"the frame at {stamp_ns} ns {UNSENDABLE}"
        why = first_problem("frame", error) if isinstance(error, ValidationError) else str(error)
        self.node.counters.drop(UNSENDABLE)
        self.node.failed(UNSENDABLE, f"{what}: {why}")

    def _read_progress(self, timeout_s: float) -> Progress | None:
        """The newest progress that is there or comes within `timeout_s`, or None. Updates the credit."""
        newest: Progress | None = None
        # Progress of another stream is ignored.
        item = self.node.next(timeout_s)
        while item is not None:
            if item[1].message.header.stream in (None, self.stream):
                newest = item[1].message
                self.credit.answered(newest.last_stamp_ns)
            item = self.node.next(0.0)
        return newest

    def _wait_for_credit(self, most: int) -> None:
        """Wait until at most `most` frames are in flight. Without progress for too long, they count as lost."""
        limit_s, since_s = self.node.link.credit_timeout_s, time.monotonic()
        self._read_progress(0.0)
        while self.credit.outstanding > most and not self.node.stop.is_set():
            if self._read_progress(limit_s) is not None:
                since_s = time.monotonic()
            elif time.monotonic() - since_s >= limit_s:
                lost = self.credit.give_up()
                self.node.counters.drop("lost in flight", len(lost))
                missing = [stage for stage in STAGES if stage != "source" and stage not in self.node.alive]
                text = "no progress for %.1f s: %d frames (%d to %d ns) count as lost; stages not running: %s"
                log.warning(text, limit_s, len(lost), lost[0], lost[-1], ", ".join(missing) or "none")

    def _ending(self, wait_s: float) -> Iterator[None]:
        """Publish the stream's end until fusion confirms that it is complete, or is absent for too long.

        Yields while it is not confirmed, each time after a wait of at most `wait_s`.
        """
        start_s = seen_s = time.monotonic()
        said_s = float("-inf")
        while not self.node.stop.is_set():
            now_s = time.monotonic()
            if "fusion" in self.node.alive:
                seen_s = now_s
            if now_s - start_s > _END_LIMIT_S or now_s - seen_s > self.node.link.credit_timeout_s:
                log.warning("fusion has not confirmed the end of the stream after %.0f s", now_s - start_s)
                return
            if now_s - said_s >= _END_INTERVAL_S:
                said_s = now_s
                header = self.node.numbered(END, self._header(self.last_stamp_ns))
                self.node.publish(END, End(header=header, frames_sent=self.in_stream))
            progress = self._read_progress(wait_s)
            if progress is not None:
                if progress.complete and progress.last_stamp_ns >= self.last_stamp_ns:
                    return
                start_s = now_s
            yield
