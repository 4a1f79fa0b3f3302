"""Tiny made-up data sets in the layouts of the real ones."""

from pathlib import Path

import cv2
import numpy as np
from scipy.io import savemat

SHAPE = (48, 64)
FIELDS = [(name, object) for name in ("category", "instance", "top", "bottom", "left", "right")]


def write_png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def write_osd(folder: Path) -> None:
    """learn2 has a table (1) with objects 2 and 3, learn10 nothing but the table."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "camera-intrinsics.txt").write_text("525 0 31.5\n0 525 23.5\n0 0 1\n")
    for name, objects in (("learn2", True), ("learn10", False)):
        annotation = np.ones(SHAPE, np.uint8)
        if objects:
            annotation[10:20, 5:25] = 2
            annotation[30:31, 40:44] = 3
        write_png(folder / "image_color" / f"{name}.png", np.full((*SHAPE, 3), 90, np.uint8))
        write_png(folder / "depth" / f"{name}.png", np.full(SHAPE, 1500, np.uint16))
        write_png(folder / "annotation" / f"{name}.png", annotation)


def write_rgbd_scenes(folder: Path) -> None:
    """One sequence of three frames with two boxes, none and one."""
    scene = folder / "desk" / "desk_1"
    for number in (1, 2, 3):
        write_png(scene / f"desk_1_{number}.png", np.full((*SHAPE, 3), 90, np.uint8))
        write_png(scene / f"desk_1_{number}_depth.png", np.full(SHAPE, 1500, np.uint16))
    cells = np.empty((1, 3), object)
    cells[0, 0] = np.array([[("cap", 1, 11, 20, 6, 25), ("bowl", 2, 1, 2, 1, 4)]], FIELDS)
    cells[0, 1] = np.zeros((0, 0))
    cells[0, 2] = np.array([[("cap", 1, 12, 20, 6, 25)]], FIELDS)
    savemat(folder / "desk" / "desk_1.mat", {"bboxes": cells})


def uw_cloud() -> tuple[np.ndarray, np.ndarray]:
    """A table 1 m in front of the camera, facing it, with two bowls on it: points (n, 3), labels (n,)."""
    grid = np.stack(np.meshgrid(np.arange(-0.3, 0.3, 0.01), np.arange(-0.2, 0.2, 0.01)), axis=-1).reshape(-1, 2)
    table = np.column_stack((grid, np.full(len(grid), 1.0)))
    block = np.stack(np.meshgrid(*3 * [np.arange(0, 0.06, 0.01)]), axis=-1).reshape(-1, 3)
    bowls = [block + np.array((x, 0.0, 0.93)) for x in (-0.2, 0.1)]
    labels = [9] * len(table) + [1] * (2 * len(block))
    return np.concatenate((table, *bowls)).astype(np.float32), np.array(labels)


def write_uw_scenes(folder: Path, units: int = 1000) -> None:
    """Scene 01 with two frames from the same place."""
    xyz, labels = uw_cloud()
    for number in (0, 1):
        write_png(folder / "imgs" / "scene_01" / f"{number:05d}-color.png", np.full((480, 640, 3), 90, np.uint8))
        write_png(folder / "imgs" / "scene_01" / f"{number:05d}-depth.png", np.full((480, 640), units, np.uint16))
    pc = folder / "pc"
    pc.mkdir(parents=True)
    header = f"ply\nformat ascii 1.0\nelement vertex {len(xyz)}\nproperty float x\nproperty float y\nproperty float z\n"
    rows = "".join(f"{x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in xyz)
    (pc / "01.ply").write_text(f"{header}end_header\n{rows}")
    (pc / "01.label").write_text("\n".join(map(str, (len(labels), *labels))))
    (pc / "01.pose").write_text("1 0 0 0 0 0 0\n1 0 0 0 0 0 0\n")
