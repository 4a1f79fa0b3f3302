"""`spot3d run` on a recording of the RealSense SDK, through all processes."""

import json
from pathlib import Path

import cv2
import numpy as np
from software_camera import UNIT, SoftwareCamera, record

from commands import spot3d
from spot3d.camera import Intrinsics
from spot3d.source.scene.scene import Scene

CAMERA = Intrinsics(292.5, 292.5, 159.5, 119.5, 320, 240)
FRAMES = 10
WITHOUT_VIEWS = 780
"""Height in pixels of an overview that shows the scene from above only."""


def test_a_recording_of_the_sdk_through_all_processes(tmp_path: Path) -> None:
    scene = Scene(frames=FRAMES, intrinsics=CAMERA)
    images = [(np.rint(frame.depth_metres() / UNIT).astype(np.uint16), frame.colour.copy()) for frame in scene]
    record(SoftwareCamera(CAMERA), tmp_path / "walk.db3", images, gap_ms=250.0)
    out = tmp_path / "out"
    done = spot3d("run", str(tmp_path / "walk.db3"), "--out", str(out))
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((out / "report.json").read_text())
    assert report["image"] == {"width": CAMERA.width, "height": CAMERA.height}
    frames = report["frames"]
    assert frames["input"] == frames["fused"] + sum(frames["skipped"].values()) > 0
    assert frames["fused"] > 0
    assert report["keyframes"] > 0, "the recording waits for the stage that looks at keyframes"
    overview = cv2.imread(str(out / "overview.png"))
    assert overview is not None
    assert overview.shape[0] > WITHOUT_VIEWS, "views of the camera with boxes are in the picture"
