"""A pose stage that dies amid a live stream: its successor is lost, or right, and never begins anew without a word."""

from dataclasses import replace

import numpy as np
from dataflow_stages import STAGES, Ear, Stages, listening, playing, wait_alive
from numpy.typing import NDArray

from commands import spot3d
from spot3d.camera import Intrinsics
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.snapshot_writer import snapshot_path
from spot3d.frame import RgbdFrame
from spot3d.source.sequence import FrameSequence
from spot3d.source.sequences import open_source
from spot3d_schemas import Health, Pose

SHOTS, PERIOD_NS = 40, 33_000_000
OFF_M = 0.05
"""They are off by less than a millimetre here; the rest is for machines that drop frames."""


class Camera(FrameSequence):
    """A camera without an end that moves to and fro before the built-in scene, and waits for the pose of each frame.

    So it is as slow as the machine is busy. Its frames bring no poses: the world is that of the first one.
    """

    rate_hz, has_true_poses = 30.0, False

    def __init__(self, ear: Ear) -> None:
        scene = open_source("scene:0", SHOTS, halved=True)
        self.intrinsics: Intrinsics = scene.intrinsics
        self.shots = [replace(frame, T_world_camera=None) for frame in scene]
        start = np.linalg.inv(np.asarray(scene.true_pose(0)))
        self.path = [start @ np.asarray(scene.true_pose(index)) for index in range(SHOTS)]
        self.stamps_ns = [index * PERIOD_NS for index in range(100_000)]
        self.covered = False
        self._ear = ear

    def true_pose(self, index: int) -> None:
        """None is told."""

    def place(self, stamp_ns: int) -> NDArray[np.float64]:
        """(3,) where the camera was at this stamp, metres, in the world of its first frame."""
        return np.asarray(self.path[self._shot(stamp_ns // PERIOD_NS)][:3, 3])

    def _shot(self, index: int) -> int:
        there_and_back = index % (2 * SHOTS - 2)
        return min(there_and_back, 2 * SHOTS - 2 - there_and_back)

    def __getitem__(self, index: int) -> RgbdFrame:
        poses: list[Pose] = self._ear.heard["pose/pose"]
        with self._ear.changed:
            before_ns = (index - 1) * PERIOD_NS
            self._ear.changed.wait_for(lambda: bool(poses) and poses[-1].header.stamp_ns >= before_ns, 0.3)
        shot = self.shots[self._shot(index)]
        if self.covered:
            shot = replace(shot, colour=np.zeros_like(shot.colour), depth=np.zeros_like(shot.depth))
        return replace(shot, stamp_ns=self.stamps_ns[index])


def state(ear: Ear, stage: str) -> str:
    health: Health | None = ear.health(stage)
    return "" if health is None else health.state


def ok(poses: list[Pose]) -> list[Pose]:
    return [pose for pose in poses if pose.status == "ok"]


def senders(poses: list[Pose]) -> set[str | None]:
    return {pose.header.sender for pose in poses}


def since(poses: list[Pose], earlier: set[str | None]) -> list[Pose]:
    """What others than the earlier processes have said."""
    return [pose for pose in poses if pose.header.sender not in earlier]


def test_a_killed_pose_stage_is_lost_until_it_knows_where_it_is() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="flying", connect=(endpoint,), health_interval_s=0.2, snapshot_interval_s=0.5)
    with (
        open_router((endpoint,)) as session,
        listening(session, "flying", "pose/pose") as ear,
        Stages(link, pose="kiss") as stages,
    ):
        camera, poses = Camera(ear), ear.heard["pose/pose"]
        stages.start(*STAGES)
        wait_alive(session, "flying", set(STAGES))
        with playing(stages.link, camera):
            begins_in_its_map(stages, ear, camera, poses)
            begins_another_world(stages, ear, poses)


def begins_in_its_map(stages: Stages, ear: Ear, camera: Camera, poses: list[Pose]) -> None:
    """Killed, and started again before a covered camera: lost, told so, and found again in the same world."""
    kept = snapshot_path(stages.link, "pose")
    ear.wait(lambda: len(ok(poses)) >= 2 * SHOTS and kept.exists() and bool(ear.objects))
    assert {pose.epoch for pose in poses} == {poses[0].epoch}
    epoch, world = poses[0].epoch, ear.objects[-1].epoch
    camera.covered = True
    stages.kill("pose")
    earlier = senders(poses)
    stages.start("pose")
    ear.wait(lambda: "lost since" in state(ear, "pose"))
    assert not ok(since(poses, earlier)), "nothing is known of where it is"
    assert poses[-1].lost_since_ns is not None
    fused = ear.fused
    told = spot3d("status", "--robot", "flying", "--connect", stages.link.connect[0])
    assert "lost since" in told.stdout
    assert told.returncode == 1
    assert ear.fused == fused
    camera.covered = False
    ear.wait(lambda: len(ok(since(poses, earlier))) >= 10 and ear.fused > fused)
    for pose in ok(since(poses, earlier)):
        assert pose.epoch == epoch
        np.testing.assert_allclose(pose.T_world_camera[:3, 3], camera.place(pose.header.stamp_ns), atol=OFF_M)
    ear.wait(lambda: state(ear, "pose") == "")
    assert ear.objects[-1].epoch == world


def begins_another_world(stages: Stages, ear: Ear, poses: list[Pose]) -> None:
    """Killed, and started again without its snapshot: poses of another epoch, and a map of their own."""
    epoch, world, stream = poses[-1].epoch, ear.objects[-1].epoch, ear.stream
    stages.kill("pose")
    earlier, updates = senders(poses), len(ear.objects)
    snapshot_path(stages.link, "pose").unlink()
    stages.start("pose")
    ear.wait(lambda: len(ok(since(poses, earlier))) >= 10)
    assert epoch not in {pose.epoch for pose in since(poses, earlier)}
    ear.wait(lambda: ear.objects[-1].epoch != world)
    first = next(update for update in ear.objects[updates:] if update.epoch != world)
    assert first.header.stream == stream, "the same flight"
    assert first.frame_count <= len(since(poses, earlier)), "of frames since then alone"
    ear.wait(lambda: (health := ear.health("fusion")) is not None and health.events.get("another world") == 1)
