import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import spot3d
from spot3d.cli import app as cli
from spot3d.cli.options import CommandError, check_outputs, out_folder
from spot3d.pose.estimate import GIVEN_JUMPED
from spot3d.recorder.mcap_writer import McapWriter
from spot3d.recorder.profile import PROFILE
from spot3d.run.report import RunReport, StageReport
from spot3d.run.results import RunResult
from spot3d.run.run import Finished
from spot3d.source.sequence import FrameList
from spot3d_schemas import MESSAGES, TOPICS

runner = CliRunner()


def test_topics_prints_the_whole_table():
    result = runner.invoke(cli.app, ["topics", "--robot", "drone"])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert len(lines) == 1 + len(TOPICS)
    for topic, line in zip(TOPICS.values(), lines[1:], strict=True):
        assert line.split()[:2] == [f"spot3d/drone/{topic.name}", topic.message.__name__]


def test_the_version_is_printed():
    result = runner.invoke(cli.app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"spot3d {spot3d.__version__}\n")


@pytest.mark.parametrize("name", [*MESSAGES, "spot3d.Frame"])
def test_schema_prints_json(name):
    result = runner.invoke(cli.app, ["schema", name])
    assert result.exit_code == 0
    assert json.loads(result.output)["properties"]["header"]


def test_settings_prints_what_can_be_read_again(tmp_path):
    first = runner.invoke(cli.app, ["settings", "--preset", "paper"]).output
    path = tmp_path / "paper.toml"
    path.write_text(first, encoding="utf-8")
    assert runner.invoke(cli.app, ["settings", "--settings", str(path)]).output == first


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["schema", "Frome"], "there is no message 'Frome'; choose from Frame"),
        (["topics", "--robot", "a b"], "link.robot: 'a b' cannot be part of a key"),
        (["run", "/nowhere/at/all", "--out", "{tmp}"], "/nowhere/at/all does not exist"),
        (["run", "/nowhere/at/all"], "/nowhere/at/all does not exist"),
        (["run", "scene", "--out", "{tmp}", "--pose", "magic"], "--pose magic: choose kiss or gicp"),
        (["run", "scene:abc", "--out", "{tmp}"], "scene:abc is not a built-in scene; give scene, scene:SEED,"),
        (["run", "scenes:2", "--out", "{tmp}"], "for spot3d evaluate scenes:COUNT"),
        (["source", "scene:1:nonsense"], "scene:1:nonsense is not a built-in scene"),
        (["evaluate", "points", "scenes:x"], "scenes:x is not a built-in scene"),
        (["run", "scene", "--out", "{tmp}", "--intrinsics", "1,2"], "four numbers"),
        (["run", "realsense:", "--out", "{tmp}"], "realsense: lacks a serial number"),
        (["run", "scene", "--out", "{tmp}", "--in-process", "--pose", "a/b"], "--in-process cannot receive topics"),
        (["run", "scene", "--out", "{tmp}", "--pose", "/odom"], "--pose /odom is not a key"),
        (["run", "scene", "--out", "{tmp}", "--depth-topic", "/d"], "scene is not a ROS bag: omit --depth-topic"),
        (["source", "scene", "--colour-topic", "/c", "--pose-topic", "/p"], "omit --colour-topic and --pose-topic"),
        (["run", "scene", "--out", "{tmp}", "--in-process", "--dashboard"], "--in-process publishes no messages"),
        (["run", "scene", "--out", "{tmp}/file/x", "--frames", "1"], "file/x: a part of its path is a file"),
        (["demo", "--out", "{tmp}/file", "--frames", "1"], "cannot use {tmp}/file: it is a file, but a folder is"),
        (["results", "{tmp}/file"], "cannot use {tmp}/file: it is a file, but a folder is needed; give another path"),
        (["certificates", "drone", "--out", "{tmp}/file"], "cannot use {tmp}/file: it is a file"),
        (["router", "--stages", "{tmp}/file/socket"], "cannot use {tmp}/file: it is a file"),
        (["pose", "--connect", "nonsense"], "link.connect.0"),
        (["fusion", "--settings", "/nowhere.toml"], "/nowhere.toml: it, or the folder that it is in, does not exist"),
        (["settings", "--settings", "{tmp}"], "cannot read settings from {tmp}: it is a folder, but a file is needed"),
        (["fusion", "--resume", "{tmp}"], "cannot use {tmp}: it is a folder, but a file is needed"),
        (["status", "--connect", "tcp/127.0.0.1:1"], "no router answers at tcp/127.0.0.1:1"),
        (["record", "{tmp}/new.mcap", "--topics", "sauce/*"], "no topic matches 'sauce/*'; choose from source/frame"),
        (["record", "{tmp}/file"], "file already exists"),
        (["record", "{tmp}/none/new.mcap"], "none/new.mcap: it, or the folder that it is in, does not exist"),
        (["play", "/nowhere.mcap"], "/nowhere.mcap does not exist; give a file written by spot3d record"),
        (["play", "{tmp}/file"], "file is not a recording of spot3d"),
        (["export", "{tmp}", "{tmp}/new.mcap"], "report.json is missing"),
        (["export", "{tmp}", "{tmp}/boxes.ply"], "boxes.ply would be an MCAP file; give a name that ends in .mcap"),
        (["evaluate", "points", "/nowhere", "--json", "{tmp}/file/x.json"], "cannot use {tmp}/file: it is a file"),
        (["evaluate", "points", "/nowhere", "--json", "{tmp}"], "cannot use {tmp}: it is a folder"),
        (["evaluate", "points", "/nowhere", "--plots", "{tmp}/file"], "cannot use {tmp}/file: it is a file"),
        (["bench", "--data", "/nowhere", "--json", "{tmp}/file/x.json"], "cannot use {tmp}/file: it is a file"),
        (["router", "--listen", "tcp/256.0.0.1:1"], "check that it is an address of this device"),
        (["router", "--listen", "tcp/127.0.0.1"], "link.listen.0: expected tcp/ADDRESS:PORT"),
        (["bridge", "--ground", "tcp/10.0.0.1"], "bridge.ground.0: expected tcp/ADDRESS:PORT"),
    ],
)
def test_what_a_user_can_put_right_is_one_line(arguments, said, tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "argv", ["spot3d", *(text.format(tmp=tmp_path) for text in arguments)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("error: ")
    assert said.format(tmp=tmp_path) in error
    assert "[Errno" not in error
    assert "\n" not in error


def write_what_ends_like_a_bag(path):
    """A recording of ours, or as much of one of RealSense's SDK as it is known by."""
    if path.suffix == ".mcap":
        McapWriter(path, PROFILE, "test").close()
    elif path.suffix == ".db3":
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("CREATE TABLE topics (name TEXT)")
            connection.execute("INSERT INTO topics VALUES ('/device_0/sensor_0/Depth_0/image/data')")
    else:
        head = b"#ROSBAG V2.0\n\x45\x00\x00\x00\x12\x00\x00\x00index_pos=" + (200).to_bytes(8, "little")
        path.write_bytes(head.ljust(200, b"\0") + b"topic=/device_0/sensor_0/Depth_0/image/data")


@pytest.mark.parametrize("name", ["flight.mcap", "walk.bag", "walk.db3"])
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["run", "{input}", "--out", "{tmp}", "--depth-topic", "/d"],
            "{input} is not a ROS bag: omit --depth-topic",
        ),
        (["source", "{input}", "--pose-topic", "/p"], "{input} is not a ROS bag: omit --pose-topic"),
        (["run", "{input}", "--out", "{tmp}", "--pose", "/odom"], "--pose /odom is not a key of poses"),
    ],
)
def test_topics_of_recordings_that_only_end_like_a_bag_are_refused(name, options, said, tmp_path, monkeypatch, capsys):
    path = tmp_path / name
    write_what_ends_like_a_bag(path)
    monkeypatch.setattr("spot3d.source.process.run", lambda *_arguments, **_named: None)
    monkeypatch.setattr(sys, "argv", ["spot3d", *(text.format(tmp=tmp_path, input=path) for text in options)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith(f"error: {said.format(input=path)}")


def test_images_that_no_message_holds_are_refused_in_one_line(tmp_path, monkeypatch, capsys):
    image = np.zeros((1944, 2592), np.uint16)
    assert cv2.imwrite(str(tmp_path / "frame-000000.depth.png"), image)
    assert cv2.imwrite(str(tmp_path / "frame-000000.color.png"), np.dstack([image.astype(np.uint8)] * 3))
    (tmp_path / "camera-intrinsics.txt").write_text("2000 0 1296 0 2000 972 0 0 1")
    monkeypatch.setattr(sys, "argv", ["spot3d", "run", str(tmp_path), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith("error: images of 2592 x 1944 pixels are too large for a message")
    assert error.endswith("use --half")


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("scene", "scene"),
        ("scene:0:cluttered", "scene-0-cluttered"),
        ("realsense", "realsense"),
        ("data/kitchen", "kitchen"),
        ("data/kitchen/", "kitchen"),
        ("data/kitchen/..", "data"),
        ("data/seq.01", "seq.01"),
        ("flight.2.mcap", "flight.2"),
        (".", "here"),
        ("/", "run"),
    ],
)
def test_results_go_by_the_name_of_the_input(name, folder, tmp_path, monkeypatch):
    here = tmp_path / "here"
    for below in ("kitchen", "seq.01"):
        (here / "data" / below).mkdir(parents=True)
    (here / "flight.2.mcap").touch()
    monkeypatch.chdir(here)
    assert out_folder(name) == Path("out", folder)


def test_results_do_not_go_into_the_input(tmp_path, monkeypatch):
    kitchen = tmp_path / "out" / "kitchen"
    (kitchen / "depth").mkdir(parents=True)
    (kitchen / "depth" / "1.png").touch()
    (tmp_path / "link").symlink_to(kitchen)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CommandError, match="out/kitchen is the input itself"):
        out_folder("out/kitchen/")
    for given in (Path("out/kitchen"), kitchen / "depth" / "..", Path("link")):
        with pytest.raises(CommandError, match="is the input itself"):
            out_folder("out/kitchen", given)
    with pytest.raises(CommandError, match="out/kitchen/depth holds images of the input"):
        out_folder("out/kitchen", Path("out/kitchen/depth"))


def test_results_may_go_into_a_folder_of_their_own_inside_the_input(tmp_path):
    assert out_folder(str(tmp_path), tmp_path / "found") == tmp_path / "found"
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "overview.png").touch()
    assert out_folder(str(tmp_path), tmp_path / "found") == tmp_path / "found"


@pytest.mark.parametrize("name", ["scene", "realsense"])
def test_an_input_that_is_no_folder_gives_its_name_to_any(name, tmp_path, monkeypatch):
    (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    assert out_folder(name, Path(name)) == Path(name)


def test_a_run_into_its_input_writes_nothing_there(tmp_path, monkeypatch, capsys):
    (tmp_path / "trajectory.txt").write_text("the user's own")
    monkeypatch.setattr(sys, "argv", ["spot3d", "run", str(tmp_path), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert f"{tmp_path} is the input itself; choose another folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory.txt"]


@pytest.mark.parametrize(
    ("more", "folder", "listen", "usual"),
    [
        ([], "out/scene", (), "tcp/127.0.0.1:7447"),
        (["--out", "results"], "results", (), "tcp/127.0.0.1:7447"),
        (["--listen", "tcp/127.0.0.1:7450"], "out/scene", ("tcp/127.0.0.1:7450",), None),
    ],
)
def test_a_run_is_reached_at_the_usual_endpoint_unless_told_another(more, folder, listen, usual, monkeypatch):
    asked = []

    def refuse(_chosen, _settings, *rest):
        asked.extend(rest)
        raise CommandError("not now")

    monkeypatch.setattr("spot3d.run.run.run", refuse)
    assert isinstance(runner.invoke(cli.app, ["run", "scene", *more]).exception, CommandError)
    assert (asked[0], *asked[-3:]) == (Path(folder), listen, usual, None)


def test_what_cannot_be_written_to_is_refused(tmp_path, monkeypatch):
    """Permissions are asked for, not tried: root may do all."""
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path / "kept.json")
    check_outputs(tmp_path / "new" / "numbers.json", tmp_path / "plots")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "plots"]
    (tmp_path / "kept.json").touch()
    with pytest.raises(PermissionError, match=r"kept\.json"):
        check_outputs(tmp_path / "kept.json", None)


def test_the_light_commands_load_no_algorithm():
    code = (
        "import sys; from typer.testing import CliRunner; from spot3d.cli.app import app\n"
        "import spot3d.run.status\n"
        "assert CliRunner().invoke(app, ['topics']).exit_code == 0\n"
        "assert CliRunner().invoke(app, ['schema', 'Pose']).exit_code == 0\n"
        "print(sorted({'numba', 'cv2', 'sklearn', 'scipy', 'kiss_icp'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout.strip() == "[]"


def test_a_run_whose_output_nobody_reads_any_more_writes_its_results(tmp_path: Path) -> None:
    """Such as one before `head`, or before a `tee` that Ctrl-C has ended."""
    arguments = ["run", "scene", "--frames", "2", "--half", "--in-process", "--out", str(tmp_path / "out")]
    with subprocess.Popen([sys.executable, "-m", "spot3d", *arguments], stdout=subprocess.PIPE) as running:
        assert running.stdout is not None
        running.stdout.close()
        assert running.wait(120) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["error"], report["frames"]["fused"]) == (None, 2)


def test_a_missing_package_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "cv2", None)
    importers = ("spot3d.run.", "spot3d.drawing.", "spot3d.source.images")
    for name in [name for name in sys.modules if name.startswith(importers)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "argv", ["spot3d", "run", "scene", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert "pip install" in capsys.readouterr().err


def test_a_run_says_that_its_camera_began_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = RunReport("scene", "processes", 9, (640, 480), fused=9, earlier_streams=[{"fused": 5}])
    done = Finished(tmp_path, FrameList(), RunResult(), report)
    monkeypatch.setattr("spot3d.run.run.run", lambda *_arguments: done)
    result = runner.invoke(cli.app, ["run", "scene", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert f"the camera's stream restarted: earlier results are in {tmp_path / 'streams'}" in result.output


@pytest.mark.parametrize("pose", ["kiss", "truth", "robot/odom"])
def test_given_poses_are_doubted_where_no_two_views_agree(
    pose: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = RunReport("scene", "processes", 9, (640, 480), fused=9)
    done = Finished(tmp_path, FrameList(), RunResult(frame_count=9, left_out={"seen too seldom": 42}), report)
    monkeypatch.setattr("spot3d.run.run.run", lambda *_arguments: done)
    result = runner.invoke(cli.app, ["run", "scene", "--out", str(tmp_path), "--pose", pose])
    assert result.exit_code == 0, result.output
    assert "no objects: 42 candidates" in result.output
    assert ("are the given poses camera-to-world" in result.output) == (pose != "kiss")


@pytest.mark.parametrize("pose", ["kiss", "truth"])
def test_given_poses_that_jumped_are_doubted(pose: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stages = {"pose": StageReport(events={GIVEN_JUMPED: 2})}
    report = RunReport("scene", "processes", 9, (640, 480), fused=9, stages=stages)
    done = Finished(tmp_path, FrameList(), RunResult(frame_count=9), report)
    monkeypatch.setattr("spot3d.run.run.run", lambda *_arguments: done)
    result = runner.invoke(cli.app, ["run", "scene", "--out", str(tmp_path), "--pose", pose])
    assert ("the given poses jumped 2 times" in result.output) == (pose == "truth")


@pytest.mark.parametrize("fused", [0, 9])
def test_the_unit_of_depth_is_doubted_only_where_frames_were_fused(
    fused: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spot3d.run.left_out.first_depth", lambda *_: "the median depth of the first frame")
    done = Finished(tmp_path, FrameList(), RunResult(), RunReport("folder", "processes", 9, (640, 480), fused=fused))
    monkeypatch.setattr("spot3d.run.run.run", lambda *_arguments: done)
    result = runner.invoke(cli.app, ["run", "scene", "--out", str(tmp_path)])
    assert ("the median depth of the first frame" in result.output) == (fused > 0)


def test_a_run_says_that_it_was_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = RunReport("scene", "processes", 3000, (640, 480), fused=160, interrupted=True)
    done = Finished(tmp_path, FrameList(), RunResult(), report)
    monkeypatch.setattr("spot3d.run.run.run", lambda *_arguments: done)
    result = runner.invoke(cli.app, ["run", "scene", "--out", str(tmp_path)])
    assert result.exit_code == 130, result.output
    assert "0 objects from 160 of 3000 frames in 0.0 s (interrupted; not fused: 2840 not reached); " in result.output
