"""The soak's judgement, and what it reads of a process."""

import os

import pytest

from spot3d.bench.readings import Reading, charts, growths, minute_table, read_process


def readings(memory_a_minute: float = 0.0, threads_a_minute: float = 0.0) -> list[Reading]:
    """Nine minutes of two processes, of which the second grows."""
    found = []
    for step in range(108):
        minute = step / 12
        found.append(Reading("pose", 60 * minute, 200.0 + step % 3, 20, 9, step, 0))
        memory, threads = 300 + memory_a_minute * minute, 9 + int(threads_a_minute * minute)
        found.append(Reading("fusion", 60 * minute, memory, 20, threads, 0, 10 * step))
    return found


@pytest.mark.parametrize(
    ("leak", "found"),
    [
        ((0.0, 0.0), set()),
        ((10.0, 0.0), set()),
        ((40.0, 0.0), {("fusion", "memory_mb")}),
        ((0.0, 3.0), {("fusion", "threads")}),
    ],
)
def test_what_grows_is_named(leak: tuple[float, float], found: set[tuple[str, str]]) -> None:
    assert {(item.process, item.number) for item in growths(readings(*leak)) if item.too_much} == found


def test_a_minute_is_a_line() -> None:
    heading, *lines = minute_table(readings())
    assert heading.split()[:5] == ["minute", "fused", "drops", "pose", "fusion"]
    assert len(lines) == 9
    assert lines[1].split() == ["2", "120", "12", "202", "300"]
    assert minute_table([]) == [minute_table([])[0]]
    assert set(charts(readings())) == {"memory_mb", "descriptors", "threads", "drops"}
    assert growths([]) == []


def test_this_process_is_read_and_one_that_is_gone_is_nothing() -> None:
    memory_mb, descriptors, threads = read_process(os.getpid())
    assert memory_mb > 10
    assert descriptors > 2
    assert threads >= 1
    assert read_process(2**22 + 1) == (0.0, 0, 0)
