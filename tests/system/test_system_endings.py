"""Each ending tells the truth: in one clear line, with true counts and an exit code."""

import json
import subprocess
import sys
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from authority import make_fleet

import commands
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.source.sequences import open_source
from spot3d.whole_file import whole_file

FRAMES, BROKEN = 6, 2

TLS = {"ca": "ca.pem", "certificate": "ground.pem", "key": "ground.key"}

DYING = """
import threading, time
from spot3d.dataflow.stopping import end_with_any_thread
end_with_any_thread()
threading.Thread(target=lambda: 1 / 0, name="objects", daemon=True).start()
time.sleep(60)
"""


spot3d = partial(commands.spot3d, before=("nice", "-n", "6"))


def recording(folder: Path) -> Path:
    """Frames of the built-in scene in the layout of 7-Scenes, one of which is cut off."""
    folder.mkdir()
    frames = open_source("scene:0", FRAMES, halved=True)
    camera = frames.intrinsics
    np.savetxt(folder / "camera-intrinsics.txt", [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    for index, frame in enumerate(frames):
        start = folder / f"frame-{index:06d}"
        cv2.imwrite(f"{start}.color.png", cv2.cvtColor(frame.colour, cv2.COLOR_RGB2BGR))
        cv2.imwrite(f"{start}.depth.png", np.rint(1000 * frame.depth_metres()).astype(np.uint16))
        np.savetxt(f"{start}.pose.txt", frames.true_pose(index))
    cut = folder / f"frame-{BROKEN:06d}.depth.png"
    cut.write_bytes(cut.read_bytes()[:500])
    return folder


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_frames_that_cannot_be_read_are_counted_and_told(tmp_path: Path, more: tuple[str, ...]) -> None:
    # A library that prints when it is imported, and a process that is nice already, are in nobody's way.
    (tmp_path / "sitecustomize.py").write_text("print('a word from a library')\n")
    out = tmp_path / "out"
    done = spot3d("run", str(recording(tmp_path / "frames")), "--out", str(out), *more, PYTHONPATH=str(tmp_path))
    assert done.returncode == 1, done.stderr
    assert f"{FRAMES - 1} of {FRAMES} frames" in done.stdout
    assert "1 cannot be read" in done.stdout
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"error: 1 of {FRAMES} frames cannot be read; the last error: ")
    assert f"frame-{BROKEN:06d}.depth.png" in last
    report = json.loads((out / "report.json").read_text())
    assert report["frames"]["skipped"] == {"cannot be read": 1}
    assert "frame-000002.depth.png" in report["stages"]["source"]["last_error"]
    assert not (out / "snapshots").exists()


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_run_that_fuses_nothing_has_failed(tmp_path: Path, more: tuple[str, ...]) -> None:
    frames, out = recording(tmp_path / "frames"), tmp_path / "out"
    for path in frames.glob("*.depth.png"):
        cv2.imwrite(str(path), np.zeros((240, 320), np.uint16))
    done = spot3d("run", str(frames), "--pose", "kiss", "--out", str(out), *more)
    assert done.returncode == 1, done.stderr
    assert done.stderr.splitlines()[-1] == f"error: no frame was fused: {FRAMES} lost pose"
    assert json.loads((out / "report.json").read_text())["error"].startswith("no frame was fused")


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_frame_that_is_listed_twice_is_fused_once(tmp_path: Path, more: tuple[str, ...]) -> None:
    whole, frames, out = recording(tmp_path / "whole"), tmp_path / "frames", tmp_path / "out"
    frames.mkdir()
    camera = open_source("scene:0", 1, halved=True).intrinsics
    (frames / "intrinsics.txt").write_text(f"{camera.fx} {camera.fy} {camera.cx} {camera.cy}")
    for kind, name in (("rgb", "color"), ("depth", "depth")):
        files = [file for file in sorted(whole.glob(f"*.{name}.png")) if f"{BROKEN:06d}" not in file.name]
        lines = [f"{1 + index / 10:.6f} {file}\n" for index, file in enumerate(files)]
        (frames / f"{kind}.txt").write_text("".join([*lines[:2], *lines[1:]]))
    done = spot3d("run", str(frames), "--pose", "kiss", "--out", str(out), *more)
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "report.json").read_text())["frames"]
    assert report["skipped"] == {"duplicate stamp in the input": 1}, done.stdout
    assert report["fused"] == report["input"] - 1


def test_frames_that_no_message_holds_are_counted_and_told(tmp_path: Path) -> None:
    whole, frames, out = recording(tmp_path / "whole"), tmp_path / "frames", tmp_path / "out"
    frames.mkdir()
    camera = open_source("scene:0", 1, halved=True).intrinsics
    (frames / "intrinsics.txt").write_text(f"{camera.fx} {camera.fy} {camera.cx} {camera.cy}")
    for kind, name in (("rgb", "color"), ("depth", "depth")):
        # The first stamp lies before 1970, where no message can be.
        lines = [f"{index - 1} {whole}/frame-{index:06d}.{name}.png\n" for index in range(FRAMES) if index != BROKEN]
        (frames / f"{kind}.txt").write_text("".join(lines))
    done = spot3d("run", str(frames), "--pose", "kiss", "--out", str(out))
    assert done.returncode == 1, done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"error: 1 of {FRAMES - 1} frames cannot be sent; the last error: the frame at -10000")
    assert "greater than or equal to 0" in last
    assert json.loads((out / "report.json").read_text())["frames"]["skipped"] == {"cannot be sent": 1}


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_pose_that_no_camera_can_have_is_not_fused(tmp_path: Path, more: tuple[str, ...]) -> None:
    """Five metres off for one frame, and five hundred kilometres."""
    frames, out = recording(tmp_path / "frames"), tmp_path / "out"
    for index, off in ((3, 5.0), (4, 5e5)):
        path = frames / f"frame-{index:06d}.pose.txt"
        pose = np.loadtxt(path)
        pose[0, 3] += off
        np.savetxt(path, pose)
    done = spot3d("run", str(frames), "--pose", "given", "--out", str(out), *more)
    report = json.loads((out / "report.json").read_text())["frames"]
    counts = {"cannot be read": 1, "implausible pose": 1, "pose too far from the origin": 1}
    assert report["skipped"] == counts, done.stdout
    assert report["fused"] == FRAMES - 3


def test_an_endpoint_that_cannot_be_had_is_told_in_one_line(tmp_path: Path) -> None:
    endpoint = free_loopback_endpoint()
    with open_router((endpoint,)):
        commands = (("router", "--listen", endpoint), ("run", "scene", "--out", str(tmp_path), "--listen", endpoint))
        for command in commands:
            taken = spot3d(*command)
            assert taken.returncode == 2, taken.stderr
            assert endpoint in taken.stderr.splitlines()[-1]
            assert "cannot listen" in taken.stderr.splitlines()[-1]
            assert "end the program that listens there, or choose another" in taken.stderr.splitlines()[-1]
            assert "Traceback" not in taken.stderr
    bogus = spot3d("run", "scene", "--out", str(tmp_path), "--listen", "bogus")
    assert (bogus.returncode, len(bogus.stderr.splitlines())) == (2, 1)
    assert "bogus" in bogus.stderr


def test_a_run_listens_with_the_certificate_of_its_settings(tmp_path: Path) -> None:
    fleet = make_fleet(tmp_path / "fleet")
    settings = tmp_path / "settings.toml"
    files = "\n".join(f'{name} = "{fleet}/{file}"' for name, file in TLS.items())
    settings.write_text(f'[link]\n{files}\n[access]\ndashboards = ["dashboard"]\n')
    endpoint = free_loopback_endpoint().replace("tcp/", "tls/")
    options = ("--half", "--frames", "3", "--out", str(tmp_path / "out"), "--settings", str(settings))
    done = spot3d("run", "scene", *options, "--listen", endpoint)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 frames" in done.stdout


def test_a_process_one_of_whose_threads_dies_ends() -> None:
    done = subprocess.run([sys.executable, "-c", DYING], capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 70
    last = done.stderr.splitlines()[-1]
    assert last == "error: the process ends, as its thread 'objects' failed with ZeroDivisionError: division by zero"


def test_a_file_that_cannot_be_written_whole_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "objects.json"
    path.write_text("the last one")

    def write() -> None:
        with whole_file(path) as stream, Path("/dev/full").open("wb", buffering=0) as full:
            stream.write(b"half")
            full.write(b"the rest")

    with pytest.raises(OSError, match=f"cannot write {path}: the disk is full; free some space"):
        write()
    assert [item.name for item in tmp_path.iterdir()] == ["objects.json"]
    assert path.read_text() == "the last one"
