"""Files that any MCAP reader opens, and that lose no whole chunk however they end."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from recordings import PERIOD_NS, START_NS, damage_second_chunk, frame, write_recording

from spot3d.recorder.mcap_contents import open_mcap
from spot3d.source.errors import SourceError
from spot3d.source.sequences import open_source
from spot3d_schemas import Frame, json_schema


def test_the_mcap_library_reads_it(recording: Path) -> None:
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = list(reader.iter_messages(topics=["spot3d/robot/source/frame"]))
        assert [record.name for record in reader.iter_metadata()] == ["spot3d"]
    assert summary is not None
    assert summary.statistics is not None
    assert (summary.statistics.message_count, summary.statistics.chunk_count) == (6, 3)
    assert [item.sequence for _, _, item in messages] == list(range(6))
    assert [item.log_time - START_NS for _, _, item in messages] == [100_000_000 * seq for seq in range(6)]
    schema, channel, _ = messages[0]
    assert schema is not None
    assert (schema.name, schema.encoding, channel.message_encoding) == ("spot3d.Frame", "jsonschema", "msgpack")
    assert json.loads(schema.data) == json_schema(Frame)


def test_frames_come_back_as_they_were(recording: Path) -> None:
    sequence = open_source(recording)
    assert sequence.stamps_ns == [PERIOD_NS * seq for seq in range(6)]
    assert sequence.has_true_poses
    for index in (5, 0, 3):
        sent, got = frame(index, PERIOD_NS * index), sequence[index]
        assert (got.colour == sent.colour).all()
        assert (got.depth == sent.depth).all()
        assert got.colour.flags.writeable, "the kernels take no read-only arrays"


def test_what_was_cut_off_is_read_up_to_the_last_whole_chunk(recording: Path, tmp_path: Path) -> None:
    whole = recording.read_bytes()
    ends = [chunk.offset + chunk.length for chunk in open_mcap(recording).chunks]
    cut = tmp_path / "cut.mcap"
    for length, frames in ((ends[0], 2), (ends[1] - 1, 2), (ends[1], 4), (ends[1] + 5, 4), (ends[2] + 40, 6)):
        cut.write_bytes(whole[:length])
        contents = open_mcap(cut)
        assert (len(contents.chunks), contents.complete) == (frames // 2, False)
        assert len(open_source(cut)) == frames
    cut.write_bytes(whole[: ends[0] - 1])
    with pytest.raises(SourceError, match="contains no frames"):
        open_source(cut)


def test_damage_is_told_with_its_place(recording: Path) -> None:
    damaged = damage_second_chunk(recording)
    contents, complaints = open_mcap(recording), list[str]()
    assert len(contents.messages(contents.chunks[0])) == 2
    with pytest.raises(SourceError, match=f"damaged at byte {damaged}"):
        contents.messages(contents.chunks[1])
    left = [item.sequence for item in contents.between(contents.start_ns, contents.end_ns, complaints.append)]
    assert left == [0, 1, 4, 5]
    (said,) = complaints
    assert said.startswith(f"left out 1 of 3 chunks of messages: {recording} is damaged at byte {damaged}")


def test_an_unfinished_recording_plays_on_behind_damage(recording: Path, caplog: pytest.LogCaptureFixture) -> None:
    last = open_mcap(recording).chunks[2]
    damaged = damage_second_chunk(recording)
    recording.write_bytes(recording.read_bytes()[: last.offset + last.length])
    assert open_source(recording).stamps_ns == [PERIOD_NS * seq for seq in (0, 1, 4, 5)]
    assert f"the frames of a damaged chunk are left out: {recording} is damaged at byte {damaged}" in caplog.text


@pytest.mark.parametrize("damaged", [1, 2], ids=["the first", "all"])
def test_a_finished_recording_whose_first_frames_are_damaged(tmp_path: Path, damaged: int) -> None:
    path = tmp_path / "listed.mcap"
    sent = [("source/frame", 0.1 * seq, frame(seq, PERIOD_NS * seq)) for seq in range(4)]
    write_recording(path, [sent[:2], sent[2:]], [(seq // 2, PERIOD_NS * seq, "") for seq in range(4)])
    whole = bytearray(path.read_bytes())
    for chunk in open_mcap(path).chunks[:damaged]:
        whole[chunk.offset + chunk.length // 2] ^= 0xFF
    path.write_bytes(whole)
    if damaged == 2:
        with pytest.raises(SourceError, match="is damaged at byte"):
            open_source(path)
        return
    sequence = open_source(path)
    assert (len(sequence), sequence.intrinsics.fx, sequence.has_true_poses) == (4, 50.0, True)
    with pytest.raises(SourceError, match="is damaged at byte"):
        sequence[0]
    assert (sequence[2].depth == frame(2, 0).depth).all()


@pytest.mark.parametrize(
    ("stamps_ms", "streams"),
    [((10_000, 10_033, 0, 33, 33, 66), [None] * 6), ((-66, -33, 0, 33, 33, 66), ["a", "a", "b", "b", "b", "b"])],
    ids=["stamps go back", "another is named"],
)
def test_the_longest_stream_is_played(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, stamps_ms: tuple[int, ...], streams: list[str | None]
) -> None:
    path = tmp_path / "two.mcap"
    frames = [frame(seq, 10**6 * (100 + stamps_ms[seq]), streams[seq]) for seq in range(6)]
    write_recording(path, [[("source/frame", 0.1 * seq, item) for seq, item in enumerate(frames)]])
    sequence = open_source(path)
    assert sequence.stamps_ns == [10**6 * (100 + stamp) for stamp in (0, 33, 66)]
    assert (sequence[2].depth == frames[5].depth).all()
    assert "contains 2 streams, of 2, 3 frames" in caplog.text


def test_frames_that_are_not_later_are_left_out_and_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "twice.mcap"
    write_recording(path, [[("source/frame", 0.1 * seq, frame(seq, 10**9 + 10**8 * (seq // 2))) for seq in range(6)]])
    assert len(open_source(path)) == 3
    assert "3 of 6 frames have a timestamp no later than the one before, and are left out" in caplog.text


def test_a_list_of_frames_in_chunks_that_are_not_there_is_told(tmp_path: Path) -> None:
    path = tmp_path / "listed.mcap"
    sent = [("source/frame", 0.1 * seq, frame(seq, PERIOD_NS * (seq + 1))) for seq in range(2)]
    write_recording(path, [sent], [(0, PERIOD_NS, ""), (99, 2 * PERIOD_NS, "")])
    sequence = open_source(path)
    assert (sequence[0].depth == frame(0, 0).depth).all()
    with pytest.raises(SourceError, match=r"listed\.mcap, frame 1: list index out of range"):
        sequence[1]


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(b"\x89MCAP0\r\n\x01" + bytes(40))
    with pytest.raises(SourceError, match="not a recording of spot3d"):
        open_mcap(path)
    with pytest.raises(SourceError, match="not a ROS 2 bag"):
        open_source(path)


def test_a_damaged_record_of_metadata_is_left_out(recording: Path, caplog: pytest.LogCaptureFixture) -> None:
    whole = recording.read_bytes()
    at = whole.index(b"robot")  # the name of a value: no UTF-8 any more
    recording.write_bytes(whole[:at] + b"\xff" + whole[at + 1 :])
    contents = open_mcap(recording)
    assert len(contents.chunks) == 3
    assert contents.robot == "robot"
    assert "is damaged at byte" in caplog.text
