"""Asks the stages of a robot what they run on and how much they send, without taking part in the dataflow."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import zenoh

from spot3d.dataflow.endpoints import subscribe_newest
from spot3d.dataflow.payload import arrived, decoded
from spot3d.doctor.others import Answer, TopicRate, flows
from spot3d_schemas import STAGES, About, Health, Objects, key

_ASKS = 5
"""Queries per stage: the fastest reply gives the clock best."""
_ANSWER_S = 1.0
_HEALTH_WAITING = 16


def ask_all(session: zenoh.Session, robot: str) -> list[Answer]:
    """The answers of all processes that answer as one of the robot's stages; two may answer for one stage."""
    best: dict[tuple[str, str, int], Answer] = {}
    for stage in STAGES:
        for _ in range(_ASKS):
            answers = _ask(session, key(robot, f"{stage}/about"))
            for answer in answers:
                who = (stage, answer.about.host, answer.about.pid)
                if who not in best or answer.within_ms < best[who].within_ms:
                    best[who] = answer
            if not answers:
                break
    return list(best.values())


def _ask(session: zenoh.Session, where: str) -> list[Answer]:
    asked_ns = time.time_ns()
    every, none = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
    answers = []
    for reply in session.get(where, timeout=_ANSWER_S, target=every, consolidation=none):
        back_ns = time.time_ns()
        about = None if reply.ok is None else decoded(reply.ok.payload, About)
        if about is not None:  # `stages` reports if no answer is valid
            offset_ms = 1e-6 * (about.time_ns - (asked_ns + back_ns) / 2)
            answers.append(Answer(about, offset_ms, 1e-6 * (back_ns - asked_ns) / 2))
    return answers


def collect_health(session: zenoh.Session, robot: str, seconds: float) -> dict[str, list[Health]]:
    """Each stage's health messages during this time."""
    health: dict[str, list[Health]] = {stage: [] for stage in STAGES}
    with ExitStack() as stack:
        keys = {stage: key(robot, f"{stage}/health") for stage in STAGES}
        handlers = {stage: subscribe_newest(session, keys[stage], _HEALTH_WAITING, stack) for stage in STAGES}
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            for stage, handler in handlers.items():
                health[stage] += arrived(handler, Health)  # invalid messages are left out
            time.sleep(0.01)
    return health


def is_complete(session: zenoh.Session, robot: str) -> bool:
    """Whether fusion's latest objects are those of all frames of a recording that has ended."""
    with ExitStack() as stack:
        ear = subscribe_newest(session, key(robot, "fusion/objects"), 1, stack, kept=True)
        deadline_s = time.monotonic() + _ANSWER_S
        while time.monotonic() < deadline_s:
            if (objects := next(arrived(ear, Objects), None)) is not None:
                return objects.complete
            time.sleep(0.01)
    return False


def topic_rates(health: Mapping[str, Sequence[Health]]) -> list[TopicRate]:
    """The rates at which all stages send, by their own counters: listening would fill the link that is examined."""
    rates = []
    for by_stage in health.values():
        # From the first to the last message of one process: two of one name count separately.
        own = [one for one in by_stage if one.pid == by_stage[0].pid]
        rates += flows(own[0], own[-1]) if own else []
    return rates
