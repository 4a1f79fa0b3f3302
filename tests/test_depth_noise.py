from dataclasses import replace

import numpy as np
import pytest

from spot3d.camera_pose import CameraPose
from spot3d.dataflow.conversion import noise_message, rgbd_frame
from spot3d.depth_noise import KINECT_V1, PRESETS, DepthNoise, parse_noise, stereo_noise
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.settings import FusionSettings
from spot3d.heatmap.heat import weighted_heat
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.pose.features import FeatureDetector
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import sample_surface
from spot3d.proposals.propose import propose
from spot3d.proposals.settings import ProposalSettings
from spot3d.segments.finder import find_segments
from spot3d.segments.settings import SegmentsSettings
from spot3d.sensor import axial_noise_kernel
from spot3d.settings import InvalidSettingsError, load_settings
from spot3d.source.selected import open_selection, selection
from spot3d_schemas import CameraIntrinsics, Frame, Header, decode, encode


@pytest.mark.parametrize(
    ("text", "z", "expected"),
    [
        ("kinect-v1", 2.4, 0.0012 + 0.0019 * 4),
        ("stereo:0.05,400", 2.0, 0.000289 + 4 * 0.08 / 20),
        ("stereo:0.05,400,0.04", 2.0, 0.000289 + 4 * 0.04 / 20),
        ("0.001,0.0005,0.5", 2.5, 0.003),
        ("d435", 2.0, 0.0146),  # RMS error = z^2 subpixel / (focal length * baseline): 4 * 0.08 / (447 * 0.05)
    ],
)
def test_noise_by_name_and_by_numbers(text: str, z: float, expected: float) -> None:
    noise = parse_noise(text)
    assert noise.sigma(z) == pytest.approx(expected, rel=1e-2)
    assert axial_noise_kernel(np.float32(z), noise.coefficients()) == pytest.approx(noise.sigma(z), rel=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        *("", "d999", "stereo:0.05", "stereo:0,400", "1,2", "0,0.001,0.4", "nan,1,1", "x:1,2,3"),
        # Millimetres, and what no camera has.
        *("1.2,1.9,400", "0.001,0.1,8", "1e-23,0,0", "stereo:0.05,0.424", "stereo:50,400", "stereo:400,0.05"),
    ],
)
def test_what_is_no_noise_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"noise|baseline") as refused:
        parse_noise(text)
    assert "\n" not in str(refused.value)
    if text:
        with pytest.raises(InvalidSettingsError, match="depth_noise"):
            load_settings(overrides={"source": {"depth_noise": text}})


def test_a_longer_baseline_and_time_of_flight_are_better_far_away() -> None:
    at_3_m = {name: noise.sigma(3.0) for name, noise in PRESETS.items()}
    assert at_3_m["tof"] < at_3_m["kinect-v1"] < at_3_m["d455"] < at_3_m["d435"]
    assert stereo_noise(0.1, 400.0).sigma(2.0) < stereo_noise(0.05, 400.0).sigma(2.0)


def _seen_with(noise: DepthNoise) -> list[object]:
    """What each stage's core makes of one frame whose depth has this noise."""
    settings = load_settings(overrides={"source": {"depth_noise": ",".join(map(str, noise)), "halved": True}})
    frame = open_selection(selection("scene", 1, 1, None), settings.source)[0]
    camera, depth = frame.intrinsics, frame.depth_metres()
    assert camera.noise == noise
    surface = sample_surface(depth, camera, PoseSettings())
    features = FeatureDetector(300, 4.0).detect(frame.colour, depth, camera)
    boxes = propose(frame.colour, depth, camera, ProposalSettings())
    same_boxes = propose(frame.colour, depth, replace(camera, noise=KINECT_V1), ProposalSettings())
    heat = weighted_heat(depth, camera, same_boxes, HeatmapSettings()).heat
    found = find_segments(frame.colour, depth, heat, camera, SegmentsSettings())
    fusion = Fusion(FusionSettings())
    fusion.fuse(frame.colour, depth, heat, camera, CameraPose(np.eye(4)))
    rows = fusion.heatmap.points()
    return [surface.sigma, features.noise, boxes, found.labels, rows]


def test_every_stage_goes_by_the_frames_noise() -> None:
    kinect, worse = _seen_with(KINECT_V1), _seen_with(DepthNoise(0.004, 0.008, 0.4))
    for one, other in zip(kinect, worse, strict=True):
        assert not np.array_equal(np.asarray(one), np.asarray(other))


@pytest.mark.parametrize("noise", [None, PRESETS["d455"]])
def test_a_frame_carries_its_noise_and_none_is_a_kinects(noise: DepthNoise | None) -> None:
    message = Frame(
        header=Header(robot="r", seq=0, stamp_ns=1, frame_id="camera"),
        intrinsics=CameraIntrinsics(fx=5.0, fy=5.0, cx=2.0, cy=1.0, width=6, height=4),
        depth_scale=0.001,
        colour=np.zeros((4, 6, 3), np.uint8),
        depth=np.ones((4, 6), np.uint16),
        depth_noise=None if noise is None else noise_message(noise),
        T_world_camera=None,
    )
    assert rgbd_frame(decode(encode(message), Frame)).intrinsics.noise == (noise or KINECT_V1)
