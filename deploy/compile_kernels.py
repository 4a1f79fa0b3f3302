"""Compiles the kernels of stages into numba's cache, by running their cores on the built-in scene.

    python compile_kernels.py all|source|pose|proposals|heatmap|segments|fusion

Run once while an image is built, so that a container need not compile when it starts.
"""

import sys
from collections.abc import Sequence

import numpy as np

from spot3d.frame import RgbdFrame
from spot3d.source.scene.scene import Scene

FRAMES = 6
"""Enough that pose looks for landmarks of earlier ones, and that objects are described (FusionSettings.views_min)."""


def compile_source(scene: Scene) -> None:
    """Renders the scene, registers colour to depth, and reads an image of a ROS bag."""
    from spot3d.source.calibration import ColourCamera
    from spot3d.source.colour_registration import ColourRegistration
    from spot3d.source.ros.rvl import decode_rvl

    frame = scene[0]
    camera = ColourCamera(frame.intrinsics, np.eye(4))
    ColourRegistration(frame.intrinsics, camera).register(frame.colour, frame.depth_metres())
    decode_rvl(np.array((1, 1, 1 << 28), "<u4").tobytes())  # one pixel, which is zero


def compile_pose(scene: Scene) -> None:
    """Tracks the scene, as the stage does before it goes on line."""
    from spot3d.pose.process import track_all
    from spot3d.pose.providers import make_tracker
    from spot3d.pose.settings import PoseSettings

    track_all(make_tracker(PoseSettings()), list(scene))


def compile_proposals(scene: Scene) -> None:
    """Proposes boxes for one frame."""
    from spot3d.proposals.propose import propose
    from spot3d.proposals.settings import ProposalSettings

    frame = scene[0]
    propose(frame.colour, frame.depth_metres(), frame.intrinsics, ProposalSettings())


def compile_heatmap(scene: Scene) -> None:
    """Makes the heatmap of the true objects' outlines in one frame."""
    from spot3d.heatmap.heat import weighted_heat
    from spot3d.heatmap.settings import HeatmapSettings

    frame = scene[0]
    mask = scene.truth(0).instance
    boxes = [_outline(mask == label) for label in np.unique(mask[mask > 0])]
    weighted_heat(frame.depth_metres(), frame.intrinsics, np.array(boxes, np.float32), HeatmapSettings())


def compile_segments(scene: Scene) -> None:
    """Finds the objects of one frame by its true heat."""
    from spot3d.segments.keyframe_segments import KeyframeSegments
    from spot3d.segments.settings import SegmentsSettings

    frame = scene[0]
    keyframes = KeyframeSegments(SegmentsSettings())
    keyframes.wants(frame.stamp_ns, np.eye(4))
    keyframes.find(frame, _true_heat(scene, 0), np.eye(4))


def compile_fusion(scene: Scene) -> None:
    """Fuses the scene with true heat, poses and segments, and makes objects."""
    from spot3d.camera_pose import CameraPose
    from spot3d.frame_segments import FrameSegments
    from spot3d.fusion.fusion import Fusion
    from spot3d.fusion.settings import FusionSettings

    fusion = Fusion(FusionSettings())
    for index, frame in enumerate(scene):
        heat = _true_heat(scene, index)
        pose = CameraPose(_pose(frame))
        fusion.fuse(frame.colour, frame.depth_metres(), heat, frame.intrinsics, pose, frame.stamp_ns)
        labels = scene.truth(index).instance.astype(np.uint8)
        confidence, stands_on = np.ones(labels.max(), np.float32), np.full(labels.max(), -1, np.int8)
        segments = FrameSegments(labels, confidence, np.zeros((0, 4)), stands_on, frame.intrinsics)
        fusion.observe(segments, frame.stamp_ns)
    fusion.objects()
    fusion.heatmap.restore(*fusion.heatmap.held())
    fusion.heatmap.evict(1, fusion.settings.tau)


STAGES = {
    "source": compile_source,
    "pose": compile_pose,
    "proposals": compile_proposals,
    "heatmap": compile_heatmap,
    "segments": compile_segments,
    "fusion": compile_fusion,
}


def main(arguments: Sequence[str]) -> int:
    """Compiles the stages named; returns the exit code."""
    unknown = [name for name in arguments if name not in (*STAGES, "all")]
    if unknown or not arguments:
        sys.stderr.write(f"expected {', '.join(STAGES)} or all, got {' '.join(unknown) or 'nothing'}\n")
        return 2
    scene = Scene(frames=FRAMES)
    for name, compile_stage in STAGES.items():
        if name in arguments or "all" in arguments:
            compile_stage(scene)
    return 0


def _true_heat(scene: Scene, index: int) -> np.ndarray:
    return np.where(scene.truth(index).instance > 0, 255, 0).astype(np.uint8)


def _outline(mask: np.ndarray) -> tuple[float, float, float, float, float]:
    """Box [x, y, w, h, c] around a mask's pixels, with confidence 1."""
    rows, columns = np.nonzero(mask)
    x, y = columns.min(), rows.min()
    return x, y, columns.max() - x + 1, rows.max() - y + 1, 1.0


def _pose(frame: RgbdFrame) -> np.ndarray:
    if frame.T_world_camera is None:
        raise ValueError("the built-in scene knows its poses")
    return frame.T_world_camera


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
