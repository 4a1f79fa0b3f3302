"""A recorded lossless run gives the same objects again, and its export shows them."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from spot3d.recorder.foxglove_export import export
from spot3d.recorder.mcap_contents import open_mcap
from spot3d.settings import without_settings
from spot3d.trajectory import rotation_from_quaternion
from spot3d_schemas import TOPICS

FRAMES = 12
LIMIT_S = 240.0
"""A first start may compile kernels."""


def spot3d(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "spot3d", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=without_settings(os.environ)
    )


def done(process: subprocess.Popen[str]) -> str:
    try:
        said, _ = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, said
    return said


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folder of a lossless run, and its recording."""
    folder = tmp_path_factory.mktemp("recording")
    # By a socket, as the stages: whoever comes by the network is an onlooker, and nobody waits for him.
    out, path, endpoint = folder / "out", folder / "run.mcap", f"unixsock-stream/{folder}/socket"
    with spot3d("record", str(path), "--lossless", "--connect", endpoint) as recorder:
        try:
            assert recorder.stdout is not None
            # It waits for the run's router, and is there before the stages are.
            assert "no router" in recorder.stdout.readline()
            scene = ("run", "scene", "--half", "--frames", str(FRAMES))
            assert "none dropped" in done(spot3d(*scene, "--out", str(out), "--listen", endpoint))
            recorder.send_signal(signal.SIGINT)
            # Previews are best effort in every run: a busy machine may lose one.
            previews = "[0-9]+ [a-z]+/preview lost on the way"
            assert re.search(f"; (nothing skipped|skipped: {previews}(, {previews})*)$", done(recorder))
        finally:
            recorder.kill()
    return out, path


def test_a_replay_gives_the_same_objects(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    out, path = recorded
    contents = open_mcap(path)
    assert set(contents.topics) == {topic.name for topic in TOPICS.values() if topic.kind == "pub"}
    again = tmp_path / "again"
    assert f"{FRAMES} of {FRAMES} frames" in done(spot3d("run", str(path), "--in-process", "--out", str(again)))
    for name in ("objects.json", "objects.jsonl", "trajectory.txt", "heatmap.ply"):
        assert (again / name).read_bytes() == (out / name).read_bytes(), name
    last = json.loads((out / "objects.jsonl").read_text().splitlines()[-1])
    assert last.pop("complete")
    assert last.pop("stamp_ns") == (FRAMES - 1) * 10**9 // 30
    assert last == json.loads((out / "objects.json").read_text())


@pytest.mark.parametrize("what", ["run", "recording", "run without its input"])
def test_an_export_shows_the_objects(recorded: tuple[Path, Path], tmp_path: Path, what: str) -> None:
    out, path = recorded
    exported, complaints = tmp_path / "shown.mcap", list[str]()
    source = path if what == "recording" else out
    if what == "run without its input":
        source = tmp_path / "moved"
        source.mkdir()
        for name in ("objects.json", "objects.jsonl", "trajectory.txt", "heatmap.ply", "settings.toml"):
            (source / name).write_bytes((out / name).read_bytes())
        report = json.loads((out / "report.json").read_text())
        report["selection"]["name"] = "/nowhere"
        (source / "report.json").write_text(json.dumps(report))
    export(source, exported, complaints.append)
    assert bool(complaints) == (what == "run without its input")

    with exported.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        messages = [(channel.topic, schema, decoded) for schema, channel, _, decoded in reader.iter_decoded_messages()]
    by_topic = {topic: [decoded for name, _, decoded in messages if name == topic] for topic, _, _ in messages}
    assert {schema.name for _, schema, _ in messages if schema is not None} - {"foxglove.CompressedImage"} == {
        "foxglove.FrameTransforms",
        "foxglove.PointCloud",
        "foxglove.SceneUpdate",
        *(() if complaints else ("foxglove.CameraCalibration",)),
    }
    assert len(by_topic.get("/camera/image", ())) == (0 if complaints else FRAMES)
    poses = [item.transforms[0] for item in by_topic["/tf"] if item.transforms[0].child_frame_id == "camera"]
    assert len(poses) == FRAMES
    shown = {entity.id: entity for entity in by_topic["/objects"][-1].entities}
    found = json.loads((out / "objects.json").read_text())["objects"]
    assert found
    assert set(shown) == {str(item["id"]) for item in found}
    for item in found:
        (cube,), (label,) = shown[str(item["id"])].cubes, shown[str(item["id"])].texts
        at, turned = cube.pose.position, cube.pose.orientation
        assert [at.x, at.y, at.z] == item["centre"]
        assert [cube.size.x, cube.size.y, cube.size.z] == item["size"]
        rotation = rotation_from_quaternion(np.array([turned.x, turned.y, turned.z, turned.w]))
        assert rotation == pytest.approx(np.array(item["rotation"]), abs=1e-6)
        assert re.fullmatch(rf"{item['id']}: \d\.\d\d", label.text)
    edges = by_topic["/objects/edges"][-1]
    assert len(edges.data) > len(found) * 12 * 2 * edges.point_stride
    cloud = by_topic["/points"][0]
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "red", "green", "blue", "alpha"]
    assert len(cloud.data) > 100 * cloud.point_stride
