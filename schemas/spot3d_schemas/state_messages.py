"""The messages about the stages' progress and state."""

from typing import ClassVar

from pydantic import Field

from spot3d_schemas.fields import Count, Finite, Name, Nanoseconds, NonNegative, Reasons, Text
from spot3d_schemas.message import Message


class End(Message):
    """The source's stream has ended; repeated until fusion's progress answers that it is complete.

    The header's stamp is that of the last frame. frames_sent: how many there were.
    """

    SCHEMA: ClassVar[str] = "spot3d.End"

    frames_sent: Count


class Progress(Message):
    """What fusion has done with the frames so far; the source's credit in a lossless run.

    All frames up to `last_stamp_ns` are accounted for: fused or skipped. complete: so is the whole stream,
    and the last objects are published.
    """

    SCHEMA: ClassVar[str] = "spot3d.Progress"

    fused: Count
    skipped: Reasons
    last_stamp_ns: Nanoseconds
    complete: bool


class Health(Message):
    """The state of one stage's process. Rates and times are None until there is something to measure.

    drops: messages that were not processed, by reason. events: events that lost no message, by kind. latency: from the
    trace's first hop to this stage's message, by wall clock. step: the core's own time. Since 1.1, state: what is wrong
    now and what to do about it, for people; empty: nothing is wrong; sent, sent_bytes: messages and their bytes so far,
    by topic.
    """

    SCHEMA: ClassVar[str] = "spot3d.Health"
    VERSION: ClassVar[str] = "1.1"

    stage: Name
    pid: Count
    uptime_s: NonNegative
    received: Count
    published: Count
    drops: Reasons
    events: Reasons
    errors: Count
    last_error: Text
    rate_hz: NonNegative | None
    latency_ms_p50: Finite | None
    latency_ms_p99: Finite | None
    step_ms_p50: NonNegative | None
    step_ms_p99: NonNegative | None
    cpu_s: NonNegative
    rss_bytes: Count
    threads: Count
    state: Text = ""
    sent: Reasons = Field(default_factory=dict)
    sent_bytes: Reasons = Field(default_factory=dict)


class About(Message):
    """Versions and resources of one stage's process: its answer to a query, at once, however busy the stage is.

    time_ns: wall clock when it answered. kernels_missing: modules whose compiled kernels are not kept for the next
    start. shared_memory_bytes: shared memory left for images; 0: it is off, or the run lossless. disk, disk_free_bytes:
    where the stage keeps snapshots, and the space left there. certificate_until_ns: until when its certificate is
    valid.
    """

    SCHEMA: ClassVar[str] = "spot3d.About"

    stage: Name
    pid: Count
    host: Text
    spot3d: Text
    zenoh: Text
    python: Text
    time_ns: Nanoseconds
    kernels_missing: Count
    shared_memory_bytes: Count
    disk: Text
    disk_free_bytes: Count
    certificate_until_ns: Nanoseconds | None
