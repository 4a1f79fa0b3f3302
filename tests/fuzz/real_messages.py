"""What the stages really say about a few frames of a box before a wall: what is mutated."""

import numpy as np
from dataflow_stages import Recording, frame_message

from spot3d.dataflow.conversion import intrinsics_message, segments_message
from spot3d.pipeline import PipelineStep, run_pipeline
from spot3d.proposals.propose import propose
from spot3d.settings import load_settings
from spot3d_schemas import End, Heat, Message, Pose, Proposals, Segments

FRAMES = 8


def real_messages(robot: str) -> list[dict[str, Message]]:
    """For each frame the messages by topic: frame, boxes, heat, pose, segments, and the end of the stream."""
    settings = load_settings(overrides={"pose": {"provider": "given"}})
    recording = Recording(FRAMES, start_ns=10**18)
    steps: list[PipelineStep] = []
    run_pipeline(recording, settings, steps.append)
    told = []
    found = None
    for seq, step in enumerate(steps):
        frame = frame_message(step.frame, robot, seq)
        header, camera = frame.header, intrinsics_message(step.frame.intrinsics)
        boxes = propose(step.frame.colour, step.frame.depth_metres(), step.frame.intrinsics, settings.proposals)
        found = step.segments or found  # said of every frame, so that there is more than "no keyframe" to mutate
        images = {"intrinsics": camera, "depth_scale": 0.001, "colour": step.frame.colour, "depth": step.frame.depth}
        counts = {"accepted": step.heat.accepted, "masked": step.heat.masked, "rejected": step.heat.rejected}
        messages: dict[str, Message] = {
            "source/frame": frame,
            "proposals/boxes": Proposals(header=header, boxes=boxes),
            "heatmap/heat": Heat(header=header, **images, heat=step.heat.heat, **counts),
            "pose/pose": Pose(
                header=header,
                T_world_camera=np.array(step.pose.T_world_camera),
                status="ok",
                reason="",
                provider="given",
            ),
            "segments/segments": segments_message(header, found),
            "source/end": End(header=header, frames_sent=FRAMES),
        }
        assert isinstance(messages["segments/segments"], Segments)
        told.append(messages)
    return told
