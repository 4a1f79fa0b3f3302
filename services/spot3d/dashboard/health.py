"""Health of a robot's stages and of its bridge, in words for people."""

from collections import Counter, deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from spot3d_schemas import BRIDGE, STAGES, Health

Level = Literal["good", "waits", "bad", "ended"]

SILENT_S = 4.0
"""A stage publishes its health once a second; one that is silent for this long hangs, or is cut off."""
_CUT_S = 1.5
"""Silence before a stage is gone from which it hangs or is cut off. A process that ends is gone at once, at most a
second after its last health message; one that hangs is given up only after two seconds of silence."""
IDLE_S = 2.0
"""A stage that has done nothing for this long is reported as idle."""
_WINDOW_S = 5.0
"""Window of the rates."""
_DROPS_HZ = 0.5
_BEHIND_MS = 500.0

_INPUTS = {
    "pose": ("source",),
    "proposals": ("source",),
    "heatmap": ("source", "proposals"),
    "segments": ("heatmap",),
    "fusion": ("heatmap", "pose"),
}
"""Stages whose messages a stage needs."""
_STREAMS = {"heatmap": 2, "segments": 2, "fusion": 3}
"""Number of messages that a stage receives per frame, where more than one."""
_GIVES = {"source": "frame", "pose": "pose", "proposals": "boxes", "heatmap": "heat"}
_CHOOSES = frozenset(("segments",))
"""Stages that process only some frames on purpose."""
HEARD = (*STAGES, BRIDGE)
"""Processes that publish their health."""


@dataclass(frozen=True, slots=True)
class Word:
    """Status of one stage."""

    stage: str
    level: Level
    text: str


@dataclass(frozen=True, slots=True)
class _Heard:
    health: Health
    at_s: float


class StageRecords:
    """Latest health messages of one robot's stages and bridge. Times are monotonic seconds."""

    def __init__(self) -> None:
        self._heard: dict[str, deque[_Heard]] = {stage: deque(maxlen=16) for stage in HEARD}
        self._busy_s: dict[str, float] = {}
        self._gone_s: dict[str, float] = {}
        self._there_s: dict[str, float] = {}

    def receive(self, health: Health, now_s: float) -> None:
        """Record a health message; those of unknown stages are ignored."""
        records = self._heard.get(health.stage)
        if records is None:
            return
        if records and _restarted(records[-1].health, health):
            records.clear()  # its counts start anew
        if not records or (health.rate_hz or 0) > 0:
            self._busy_s[health.stage] = now_s
        records.append(_Heard(health, now_s))

    def latest(self, stage: str) -> Health | None:
        """The last health message of a stage, if any."""
        records = self._heard[stage]
        return records[-1].health if records else None

    def drops(self) -> dict[str, dict[str, int]]:
        """Total drops of each stage that drops, by reason."""
        latest = {stage: self.latest(stage) for stage in HEARD}
        return {stage: dict(health.drops) for stage, health in latest.items() if health is not None and health.drops}

    def words(self, alive: Collection[str], now_s: float, lost: str = "", complete: bool = False) -> list[Word]:
        """Status of each stage, and of the bridge where there is or was one.

        alive: those whose process is running; lost: why the last pose is lost, if it is; complete: whether the run's
        last objects have come, so that a stage that is gone has finished. To be called every second.
        """
        self._gone_s = {stage: self._gone_s.get(stage, now_s) for stage in HEARD if stage not in alive}
        self._there_s = {stage: self._there_s.get(stage, now_s) for stage in HEARD if stage in alive}
        bridged = BRIDGE in alive or self._heard[BRIDGE]
        return [self._word(stage, alive, now_s, lost, complete) for stage in (HEARD if bridged else STAGES)]

    def _word(self, stage: str, alive: Collection[str], now_s: float, lost: str, complete: bool) -> Word:
        records = self._heard[stage]
        silent_s = now_s - records[-1].at_s if records else 0.0
        if stage not in alive:
            if complete and not self._cut(stage):
                return Word(stage, "ended", "has ended")
            return Word(stage, "bad", self._absent(stage, silent_s))
        if not records:
            if now_s - self._there_s[stage] > SILENT_S:
                return Word(stage, "waits", "is running, but publishes no health, as your own program may not")
            return Word(stage, "waits", "is running, but has not published its health yet")
        if silent_s > SILENT_S:
            return Word(stage, "bad", f"has sent nothing for {silent_s:.0f} s: it hangs, or the link to it is cut")
        newest, oldest = records[-1].health, self._before(stage, now_s)
        if newest.state:
            return Word(stage, "bad", newest.state)
        if newest.errors > oldest.health.errors:
            return Word(stage, "bad", f"fails: {newest.last_error}")
        if stage == "pose" and lost:
            return Word(stage, "bad", f"is lost: {lost}")
        span_s = records[-1].at_s - oldest.at_s
        if stage == BRIDGE:
            # It skips images on purpose; the table of drops shows how many.
            crossed_hz = (newest.published - oldest.health.published) / span_s if span_s > 0 else 0.0
            return Word(stage, "good", f"passes on {crossed_hz:.0f} messages a second")
        idle = self._idle(stage, alive, now_s)
        if idle is not None:
            return idle
        dropped = self._dropping(newest, oldest.health, span_s)
        if dropped:
            return Word(stage, "waits", dropped)
        behind = newest.latency_ms_p50
        if behind is not None and behind > _BEHIND_MS:
            return Word(stage, "waits", f"is {behind / 1000:.1f} s behind the camera")
        return Word(stage, "good", _well(newest))

    def _absent(self, stage: str, silent_s: float) -> str:
        """Why a stage is gone: it has ended, or it hangs or is cut off."""
        if self._cut(stage):
            return f"has not answered for {silent_s:.0f} s: it hangs, or the link to it is cut"
        gone = "is not running, or the link is cut" if stage == BRIDGE else "is not running"
        return f"{gone} (for {silent_s:.0f} s)" if self._heard[stage] else gone

    def _cut(self, stage: str) -> bool:
        """Whether a stage that is gone was silent before."""
        records = self._heard[stage]
        return bool(records) and self._gone_s[stage] - records[-1].at_s > _CUT_S

    def _before(self, stage: str, now_s: float) -> _Heard:
        """The stage's oldest message in the window of the rates, otherwise its last one."""
        records = self._heard[stage]
        return next((item for item in records if now_s - item.at_s <= _WINDOW_S), records[-1])

    def _idle(self, stage: str, alive: Collection[str], now_s: float) -> Word | None:
        """What an idle stage waits for; None where it works."""
        idle_s = self._idle_s(stage, now_s)
        if idle_s < IDLE_S:
            return None
        if stage == "source":
            return Word(
                stage, "waits", f"has sent no frame for {idle_s:.1f} s: it waits for other stages, or has ended"
            )
        for giver in _INPUTS[stage]:
            if giver not in alive:
                why = f"{giver} {'does not answer' if self._cut(giver) else 'is not running'}"
                return Word(stage, "waits", f"waits: no {_GIVES[giver]} for {idle_s:.1f} s, because {why}")
        longest_s, giver = max((self._idle_s(giver, now_s), giver) for giver in _INPUTS[stage])
        if longest_s >= IDLE_S:
            return Word(stage, "waits", f"waits: no {_GIVES[giver]} for {longest_s:.1f} s")
        if stage in _CHOOSES:
            return None
        if not all(map(self.latest, _INPUTS[stage])):
            # With two inputs, either may be missing.
            sole = _GIVES[_INPUTS[stage][0]] if len(_INPUTS[stage]) == 1 else ""
            nothing = f"waits: no {sole}" if sole and self._gets_nothing(stage) else "has produced no output"
            return Word(stage, "waits", f"{nothing} for {idle_s:.1f} s")
        return Word(stage, "bad", f"receives input, but has produced no output for {idle_s:.1f} s")

    def _gets_nothing(self, stage: str) -> bool:
        """Whether a stage received no message between its last two health messages."""
        last = [item.health.received for item in self._heard[stage]][-2:]
        return len(last) == 2 and last[0] == last[1]

    def _idle_s(self, stage: str, now_s: float) -> float:
        """For how long a stage has done nothing; 0 for one that never published its health."""
        return now_s - self._busy_s.get(stage, now_s)

    def _dropping(self, newest: Health, oldest: Health, span_s: float) -> str:
        drops = Counter(newest.drops)
        drops.subtract(oldest.drops)
        if span_s <= 0 or newest.stage in _CHOOSES:
            return ""
        dropped_hz = sum(drops.values()) / span_s
        if dropped_hz < _DROPS_HZ:
            return ""
        frames_hz = (newest.received - oldest.received) / span_s / _STREAMS.get(newest.stage, 1)
        of = f" of {frames_hz:.0f}" if frames_hz >= dropped_hz else ""
        reason = max(drops, key=lambda name: drops[name])
        return f"drops {dropped_hz:.0f}{of} a second: {reason}"


def _restarted(before: Health, now: Health) -> bool:
    """Whether these are of two processes. In a container each has the same pid, and not every program names itself."""
    one, other = ((health.header.sender, health.pid) for health in (before, now))
    return one != other or now.uptime_s < before.uptime_s


def _well(health: Health) -> str:
    said = [] if health.rate_hz is None else [f"{health.rate_hz:.0f} a second"]
    if health.step_ms_p50 is not None:
        said.append(f"{health.step_ms_p50:.0f} ms per step")
    if health.latency_ms_p50 is not None:
        said.append(f"{health.latency_ms_p50:.0f} ms behind the camera")
    return ", ".join(said) or "is running"
