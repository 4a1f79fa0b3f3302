"""Findings from the stages' own answers, on whatever device they run."""

import datetime
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from spot3d import __version__
from spot3d.dataflow.about import zenoh_version
from spot3d.dataflow.clocks import offset_in_words
from spot3d.dataflow.tls import EXPIRES_SOON
from spot3d.doctor.finding import Finding, checked
from spot3d.doctor.this_device import disk, kernels, shared_memory
from spot3d_schemas import STAGES, About, Health

CLOCK_MS = 50.0
"""Messages are joined by their stamps and lags are read from clocks: with a larger offset, both mislead."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a stage answered. offset_ms: its clock minus this device's, +- within_ms, half the round trip."""

    about: About
    offset_ms: float
    within_ms: float


@dataclass(frozen=True, slots=True)
class TopicRate:
    """What one stage sends under one topic."""

    topic: str
    rate_hz: float
    bytes_per_s: float


def look_at(answers: Sequence[Answer], alive: Mapping[str, bool], ended: bool = False) -> list[Finding]:
    """Findings about all stages that answered, one per device where that suffices. alive: by liveliness token.

    ended: the source is gone because its recording is over.
    """
    findings = [stages(alive, answers, ended)]
    hosts: dict[str, list[Answer]] = defaultdict(list)
    for answer in answers:
        hosts[answer.about.host].append(answer)
    for host, there in hosts.items():
        where = f"on {host}"
        findings += [versions(host, there), clock(host, there)]
        missing = sum(answer.about.kernels_missing for answer in there)
        findings.append(kernels(missing, where))
        findings.append(shared_memory(min(answer.about.shared_memory_bytes for answer in there), where))
        least = min(there, key=lambda answer: answer.about.disk_free_bytes).about
        findings.append(disk(least.disk, least.disk_free_bytes, where))
        findings += certificates(host, there)
    return findings


def stages(alive: Mapping[str, bool], answers: Sequence[Answer], ended: bool = False) -> Finding:
    """Whether all stages are alive, and each as one process only."""
    pids: dict[str, set[tuple[str, int]]] = defaultdict(set)
    for answer in answers:
        pids[answer.about.stage].add((answer.about.host, answer.about.pid))
    for stage, processes in pids.items():
        if len(processes) > 1:
            named = ", ".join(f"{host} ({pid})" for host, pid in sorted(processes))
            return Finding(
                "problem", "stages", f"{stage} runs {len(processes)} times: {named}", "end all but one of them"
            )
    expected = [stage for stage in STAGES if not (ended and stage == "source")]
    absent = [stage for stage in expected if not alive.get(stage)]
    if absent:
        return Finding(
            "problem", "stages", f"not alive: {', '.join(absent)}", "start them; their logs say why they ended"
        )
    mute = [stage for stage in expected if stage not in pids]
    if mute:
        text = f"alive, but they do not state their versions: {', '.join(mute)}"
        return Finding("note", "stages", text, "they are an older version, or your own program")
    text = f"all alive: {', '.join(expected)}"
    return Finding("ok", "stages", f"{text}; the source has ended, as its recording is over" if ended else text)


def states(by_stage: Mapping[str, Sequence[Health]]) -> list[Finding]:
    """The problem that each stage stated last, and what to do."""
    wrong = [(stage, health[-1].state) for stage, health in by_stage.items() if health and health[-1].state]
    return [
        Finding("problem", stage, state, "watch it with: spot3d status --watch; its log has details")
        for stage, state in wrong
    ]


def versions(host: str, there: Sequence[Answer]) -> Finding:
    """Whether a device has the versions of this one."""
    here = (__version__, zenoh_version())
    versions = sorted({(answer.about.spot3d, answer.about.zenoh) for answer in there})
    text = "; ".join(f"spot3d {spot3d}, zenoh {zenoh}" for spot3d, zenoh in versions)
    if versions == [here]:
        return Finding("ok", f"versions on {host}", text)
    text += f" (here: spot3d {here[0]}, zenoh {here[1]})"
    return Finding("problem", f"versions on {host}", text, "install the same version on every device")


def clock(host: str, there: Sequence[Answer]) -> Finding:
    """The offset of a device's clock, from the fastest answer, unless another one surely differs."""
    best = min(there, key=lambda answer: answer.within_ms)
    worst = max(there, key=lambda answer: abs(answer.offset_ms) - answer.within_ms)
    if abs(worst.offset_ms) - worst.within_ms > CLOCK_MS:
        best = worst  # two devices may have one name
    text = f"{best.offset_ms:+.1f} ms against this device's, +- {best.within_ms:.1f} ms"
    if abs(best.offset_ms) - best.within_ms > CLOCK_MS:
        text = offset_in_words(best.offset_ms / 1000, "this device's") + f": {text}"
        remedy = "synchronise the clocks: chrony or systemd-timesyncd on both, the drone from the ground station"
        return Finding("problem", f"clock on {host}", text, remedy)
    if best.within_ms > CLOCK_MS:
        return Finding("note", f"clock on {host}", text, "the link is too slow for a more exact measurement")
    return Finding("ok", f"clock on {host}", text)


def certificates(host: str, there: Sequence[Answer]) -> list[Finding]:
    """Until when the stages' certificates are valid; nothing where they have none."""
    ends = [answer.about.certificate_until_ns for answer in there if answer.about.certificate_until_ns is not None]
    if not ends:
        return []
    until = datetime.datetime.fromtimestamp(min(ends) / 1e9, datetime.UTC)
    soon = until - datetime.datetime.now(datetime.UTC) < EXPIRES_SOON
    remedy = "make new ones: spot3d certificates --out FOLDER NAME --renew"
    return [checked(soon, f"certificates on {host}", f"valid until {until:%Y-%m-%d %H:%M} UTC", remedy)]


def flows(before: Health, after: Health) -> list[TopicRate]:
    """The rates of a stage's topics between two of its health messages."""
    seconds = 1e-9 * (after.header.stamp_ns - before.header.stamp_ns)
    if seconds <= 0:
        return []
    return [
        TopicRate(
            topic,
            (count - before.sent.get(topic, 0)) / seconds,
            (after.sent_bytes.get(topic, 0) - before.sent_bytes.get(topic, 0)) / seconds,
        )
        for topic, count in after.sent.items()
    ]
