"""What fusion does with its messages: joins heat, poses and segments, fuses them, and reports progress."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import zenoh

from spot3d.dataflow.cadence import Cadence
from spot3d.dataflow.conversion import camera_pose, frame_segments, rgbd_frame
from spot3d.dataflow.join import HEATS_WAITING, NO_HEAT, NO_POSE, Skipped
from spot3d.dataflow.ledger import Ledger
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.serving import On, OnQuery, serve
from spot3d.dataflow.streams import new_stream
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.inputs import NO_SEGMENTS, WITHOUT_FRAME, Arrival, Ready, inputs_of
from spot3d.fusion.map_answers import MapAnswers, changes_message
from spot3d.fusion.snapshot import Account, keep
from spot3d.fusion.snapshot_keeper import SnapshotKeeper
from spot3d.fusion.updates import Update, Updates
from spot3d.fusion.worlds import World, why_refused
from spot3d_schemas import CameraIntrinsics, End, Header, Heat, Message, Pose, Progress, Segments

log = logging.getLogger(__name__)

_HEAT, _POSE, _SEGMENTS, _END = "heatmap/heat", "pose/pose", "segments/segments", "source/end"
INPUTS = (_HEAT, _POSE, _SEGMENTS, _END)
_OBJECTS, _PROGRESS = "fusion/objects", "fusion/progress"
_MAP, _CHANGES, _RESET = "fusion/map", "fusion/changes", "fusion/reset"
OUTPUTS, QUERIES = (_OBJECTS, _PROGRESS), (_MAP, _CHANGES, _RESET)
_ALONE = 300
"""Live: after so many fused frames without a message of the segments stage, ten seconds of a camera, it is reported."""

_UNFUSED = 60
"""After so many frames in a row that are not fused, two seconds of a camera, the state says why."""
_ADVICE = {
    NO_POSE: "check that the pose stage is running; a pose must have the stamp_ns of its frame, and come at most "
    f"{HEATS_WAITING} frames after it",
    NO_HEAT: "check that the proposals and heatmap stages are running",
}
"""What to do about frames that are not fused; the first reason that there is."""

LOST, FAILED, AGAIN = "lost pose", "error", "fused before"
"""Why a frame with heat and pose is skipped."""
KEYFRAMES = "keyframes"
"""The event of a keyframe whose segments are taken in."""


M = TypeVar("M", bound=Message)


class Stage:
    """One robot's map, its objects, and the ledger of its stream."""

    def __init__(
        self,
        node: Node,
        fusion: Fusion,
        keeper: SnapshotKeeper,
        updates: Updates,
        answers: MapAnswers,
        account: Account | None,
    ) -> None:
        self.node, self.fusion, self.keeper = node, fusion, keeper
        self.updates, self.answers = updates, answers
        self.inputs = inputs_of(node.link)
        self.cadence = Cadence(fusion.settings.object_interval_s)
        self.ledger = Ledger(node.link.credit_timeout_s)
        self.unfused = Counter[str]()
        self.world = World(fusion.settings.speed_max)
        self.epoch = new_stream() if account is None else account.epoch
        self.goes_on = account is not None
        self.fused_ns, self.recording = -1, 0
        self.camera: CameraIntrinsics | None = None
        self.last: Received[Message] | None = None

    def serve(self) -> None:
        """Handle the messages, one at a time."""
        serve(
            self.node,
            On(_HEAT, Heat, partial(self._take, self.inputs.add_heat)),
            On(_POSE, Pose, partial(self._take, self.inputs.add_pose)),
            On(_SEGMENTS, Segments, self._take_segments),
            On(_END, End, self._ended),
            OnQuery(_MAP, self._answer_map),
            OnQuery(_CHANGES, self._answer_changes),
            OnQuery(_RESET, self._answer_reset),
            between=self._complete_if_due,
        )

    def keep_last(self) -> None:
        """Save what was fused since the last snapshot, once all else is closed: the stage may be started again."""
        if self.updates.ended:
            self.keeper.keep_last(self.fusion, self._account())
        else:
            log.warning("stopped during an update of the objects: the last snapshot is kept")

    def _account(self) -> Account:
        ledger = self.ledger
        return Account(
            stream=self.node.stream,
            epoch=self.epoch,
            world=self.world.epoch,
            fused_ns=self.fused_ns,
            fused=ledger.fused,
            skipped=dict(ledger.skipped),
            last_stamp_ns=ledger.last_stamp_ns,
            in_stream=ledger.in_stream,
        )

    def _take(self, add: Callable[[Received[M]], Arrival], given: Received[M]) -> None:
        self._begin_if_new(given)
        self._arrived(add(given), given)

    def _take_segments(self, given: Received[Segments]) -> None:
        self._take(self.inputs.add_segments, given)
        if not given.message.keyframe:
            self.fusion.forget(given.message.header.stamp_ns)
        self.ledger.extend_patience(time.monotonic())

    def _complete_if_due(self) -> None:
        """No frame waits for live segments, but the last objects do: a short stream may end before its first."""
        more = self.inputs.unanswered and "segments" in self.node.alive
        if self.ledger.due(time.monotonic(), more):
            self._complete()

    def _begin_if_new(self, given: Received[Message]) -> None:
        stream = given.message.header.stream
        if given.begins and stream is not None:
            self._begin_stream(stream)

    def _begin_stream(self, stream: str) -> None:
        """Reset for another scene, unless an earlier process began this stream."""
        self.node.counters.drop("of an earlier stream", self.inputs.clear())
        self.ledger = Ledger(self.node.link.credit_timeout_s)
        self._forget_unfused()
        self.last = None
        if self.goes_on:
            self.goes_on = False
            return
        self._begin_map()
        self.world = World(self.fusion.settings.speed_max)
        account = self.keeper.begin(self.fusion, stream)
        if account is not None:
            self.epoch, self.fused_ns = account.epoch, account.fused_ns
            self.world.go_on(account.world)
            self.ledger.go_on(account.fused, account.skipped, account.last_stamp_ns, account.in_stream)

    def _begin_map(self) -> None:
        """Start an empty map of another epoch, whose objects are numbered anew."""
        self.updates.forget()
        self.answers.forget()
        self.fusion.reset()
        self.cadence.reset()
        self.world.forget()
        self.epoch, self.fused_ns = new_stream(), -1

    def _arrived(self, arrival: Arrival, given: Received[Message]) -> None:
        for reason in arrival.drops:
            self.node.counters.drop(reason)
        self._account_for(arrival.frames)
        if arrival.late is not None:
            self._observe(arrival.late)
        if arrival.frames:
            self._say_progress(given)

    def _account_for(self, frames: Sequence[Ready | Skipped]) -> None:
        for frame in frames:
            if isinstance(frame, Ready):
                self._fuse(frame)
            else:
                self._skip(frame.reason, frame.stamp_ns)

    def _skip(self, reason: str, stamp_ns: int, advice: str = "") -> None:
        """Account for a frame that is not fused; if there were many in a row, say why in the state.

        Those with a lost pose are left to the state of the pose stage.
        """
        self.node.counters.drop(reason)
        self.ledger.skip(reason, stamp_ns, time.monotonic())
        if reason == LOST:
            return
        self.unfused[reason] += 1
        if (count := self.unfused.total()) >= _UNFUSED:
            reasons = ", ".join(f"{times} {why}" for why, times in self.unfused.most_common())
            advice = advice or next((text for why, text in _ADVICE.items() if why in self.unfused), "")
            self.node.state = f"no frame was fused of the last {count} ({reasons})" + (f": {advice}" if advice else "")

    def _forget_unfused(self) -> None:
        self.unfused.clear()
        self.node.state = ""

    def _fuse(self, ready: Ready) -> None:
        heat, pose = ready.heat, ready.pose
        message, stamp_ns = heat.message, heat.message.header.stamp_ns
        if stamp_ns <= self.fused_ns and heat.recording == self.recording:
            self.node.counters.drop(AGAIN)
            return
        refused = LOST if pose.message.status == "lost" else self._refused(ready)
        if refused:
            self._skip(refused, stamp_ns, why_refused(refused, pose.message.T_world_camera))
            return
        if self.camera not in (None, message.intrinsics):
            self.node.note("intrinsics changed", f"the intrinsics have changed to {message.intrinsics}")
        self.camera = message.intrinsics
        frame = rgbd_frame(message)
        start_s = time.perf_counter()
        try:
            self.fusion.fuse(
                frame.colour, frame.depth_metres(), message.heat, frame.intrinsics, camera_pose(pose.message), stamp_ns
            )
        except Exception as error:
            self.node.crashed("fuse", f"cannot fuse the frame at {stamp_ns} ns", error)
            self._skip(FAILED, stamp_ns)
            return
        self._forget_unfused()
        self.fused_ns, self.recording = stamp_ns, heat.recording
        self.world.follow(pose.message.epoch, pose.message.T_world_camera, stamp_ns)
        if ready.segments is not None:
            self._observe(ready.segments)
        self.node.counters.step(time.perf_counter() - start_s)
        self.ledger.fuse(stamp_ns, time.monotonic())
        self.last = heat
        self._note_if_alone()
        self.node.measure_latency(message.header.with_hop("fusion", heat.received_ns, time.time_ns()))
        if self.cadence.due(stamp_ns):
            self._update(heat)

    def _refused(self, ready: Ready) -> str:
        """Why a frame with a pose is not fused, or empty; the first pose of another world begins another map."""
        pose = ready.pose.message
        verdict = self.world.judge(pose.epoch, pose.T_world_camera, pose.header.stamp_ns)
        if verdict == "begins" or (pose.epoch is None and ready.heat.recording != self.recording):
            why = f"poses in another world (epoch {pose.epoch})" if pose.epoch else "another recording"
            text = f"{why}: a new map begins; the {self.fusion.frame_count} frames of the old one are left behind"
            self.node.note("another world", text)
            self.world.leave()
            self._begin_map()
            verdict = self.world.judge(pose.epoch, pose.T_world_camera, pose.header.stamp_ns)
        if why := why_refused(verdict, pose.T_world_camera):
            self.node.note("implausible poses", why)
        return "" if verdict in ("same", "begins") else verdict

    def _observe(self, given: Received[Segments]) -> None:
        """Take in a keyframe's segments; if they cannot be used, what was fused without them stays as it is."""
        stamp_ns = given.message.header.stamp_ns
        try:
            segments = frame_segments(given.message)
            if segments is None:
                self.fusion.forget(stamp_ns)
                return
            if self.fusion.observe(segments, stamp_ns):
                self.node.counters.event(KEYFRAMES)
            else:
                self.node.counters.drop(WITHOUT_FRAME)
        except Exception as error:
            self.node.crashed("observe", f"cannot use the segments of the frame at {stamp_ns} ns", error)

    def _note_if_alone(self) -> None:
        alone = self.inputs.alone
        if alone and alone % _ALONE == 0:
            text = (
                f"no segments for {alone} frames, which are fused without them: check that the segments stage is "
                "running"
            )
            self.node.note("no segments", text)

    def _update(self, heat: Received[Heat]) -> None:
        """Start an update. Live, a running one postpones it; lossless, it is made of exactly this frame."""
        if self.node.link.delivery == "live" and self.updates.busy:
            self.cadence.postpone()
        elif self.updates.wait(self._say_progress):
            self._submit(heat, complete=False)

    def _submit(self, given: Received[Message], complete: bool) -> None:
        """Start finding the objects, and saving the map if that is due."""
        fusion, heatmap, kept = self.fusion, self.fusion.heatmap, None
        if self.keeper.due(complete) and fusion.frame_count:
            kept = keep(fusion, self._account())
        update = Update(
            task=fusion.snapshot(lasting=not complete),
            frame_count=fusion.frame_count,
            given=given,
            map_points=heatmap.count,
            map_limit_reached=heatmap.evicted > 0,
            complete=complete,
            epoch=self.epoch,
            kept=kept,
        )
        self.updates.submit(update)

    def _ended(self, given: Received[End]) -> None:
        self._begin_if_new(given)
        end = given.message
        self.last = self.last or given
        if self.ledger.end(end.frames_sent, end.header.stamp_ns, time.monotonic()):
            self._say_progress(given)

    def _complete(self) -> None:
        """The stream is complete: publish the last objects, then that they are the last."""
        rest = self.inputs.rest()
        self.node.counters.drop(NO_SEGMENTS, sum(isinstance(frame, Ready) for frame in rest))
        self._account_for(rest)
        if self.last is not None and self.updates.wait(self._say_progress):
            self._submit(self.last, complete=True)
            self.updates.wait(self._say_progress)
        missing = self.ledger.close()
        self.node.counters.drop(self.ledger.missing, missing)
        self._say_progress()

    def _say_progress(self, given: Received[Message] | None = None) -> None:
        """Publish the progress, as answer to a message or by itself."""
        header = self._own_header(_PROGRESS) if given is None else self.node.header(_PROGRESS, given)
        self.node.publish(_PROGRESS, self._progress(header))

    def _progress(self, header: Header) -> Progress:
        return Progress(
            header=header,
            fused=self.ledger.fused,
            skipped=dict(self.ledger.skipped),
            last_stamp_ns=self.ledger.last_stamp_ns,
            complete=self.ledger.complete,
        )

    def _answer_changes(self, query: zenoh.Query) -> None:
        message = changes_message(self.fusion, query.parameters, self._own_header(_CHANGES), self.epoch)
        self.node.reply(query, _CHANGES, message)

    def _answer_map(self, query: zenoh.Query) -> None:
        self.answers.submit(query, self.fusion, self._own_header(_MAP), self.epoch, self.ledger.complete)

    def _answer_reset(self, query: zenoh.Query) -> None:
        name = b"somebody who gives no name" if query.payload is None else query.payload.to_bytes()[:100]
        who = name.decode(errors="replace")  # anybody may ask, with anything
        text = f"reset requested by {who!r}: {self.fusion.frame_count} frames and their objects are deleted"
        log.warning("%s", text)
        self.node.counters.event("reset")
        self._begin_map()
        self.keeper.forget()
        self.ledger.reset()
        self.last = None
        self.node.reply(query, _RESET, self._progress(self._own_header(_RESET)))

    def _own_header(self, topic: str) -> Header:
        stream, stamp_ns = self.node.stream, self.ledger.last_stamp_ns
        header = Header(robot=self.node.link.robot, seq=0, stamp_ns=stamp_ns, frame_id="camera", stream=stream)
        return self.node.numbered(topic, header)
