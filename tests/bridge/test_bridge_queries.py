"""Queries that cross the bridge hold up nothing else of the session that hears them, and refusals cross back."""

import threading
from contextlib import ExitStack

import zenoh

from spot3d.bridge.flow import QueryForwarder
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import TOPICS, key
from waiting import wait_until

ROBOT = "asked"
QUESTIONS = 8


def test_questions_that_wait_hold_up_no_messages() -> None:
    here, there = free_loopback_endpoint(), free_loopback_endpoint()
    heard, waiting = threading.Event(), list[zenoh.Query]()
    asked = threading.Event()

    def never_answer(query: zenoh.Query) -> None:
        waiting.append(query)
        asked.set()

    with ExitStack() as stack:
        asking_side, asked_side = (stack.enter_context(open_router((where,))) for where in (here, there))
        robot = stack.enter_context(open_session(LinkSettings(connect=(here,))))
        where = key(ROBOT, "fusion/map")
        stack.callback(asked_side.declare_queryable(where, never_answer).undeclare)
        stack.callback(asking_side.declare_subscriber("other", lambda _: heard.set()).undeclare)
        questions = QueryForwarder(TOPICS["fusion/map"], asked_side, asking_side, ROBOT)
        stack.callback(questions.stop)
        answers = [robot.get(where, timeout=60) for _ in range(QUESTIONS)]
        assert asked.wait(20)
        robot.put("other", b"")
        assert heard.wait(5), "it waits for answers that do not come"
        assert len(answers) == QUESTIONS
        for query in waiting:
            query.drop()


def test_why_a_query_is_refused_crosses_back() -> None:
    here, there, why = free_loopback_endpoint(), free_loopback_endpoint(), "fusion is busy; ask again"

    def refuse(query: zenoh.Query) -> None:
        with query:
            query.reply_err(why.encode())

    with ExitStack() as stack:
        asking_side, asked_side = (stack.enter_context(open_router((where,))) for where in (here, there))
        robot = stack.enter_context(open_session(LinkSettings(connect=(here,))))
        where = key(ROBOT, "fusion/reset")
        stack.callback(asked_side.declare_queryable(where, refuse).undeclare)
        forwarder = QueryForwarder(TOPICS["fusion/reset"], asked_side, asking_side, ROBOT)
        stack.callback(forwarder.stop)
        replies: list[zenoh.Reply] = []
        wait_until(lambda: bool(replies.extend(robot.get(where, timeout=5)) or replies), "the bridge answers", 20)
        assert [reply.err.payload.to_string() for reply in replies if reply.err is not None] == [why]
