"""Says whether a stage is alive: exit code 0 once a Health message of it arrives, else 1.

    python healthcheck.py source|pose|proposals|heatmap|segments|fusion

Router and robot are those of the stage's own environment (SPOT3D_LINK__CONNECT, SPOT3D_LINK__ROBOT).
"""

import queue
import sys

import zenoh

from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d.settings import load_settings
from spot3d_schemas import CodecError, Health, decode, key

WAIT_S = 4.0
"""Long enough for four messages: a busy machine may drop some."""


def is_alive(stage: str, link: LinkSettings, wait_s: float = WAIT_S) -> bool:
    """Whether a Health message of `stage` arrives within `wait_s` seconds."""
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    try:
        with zenoh.open(zenoh_config(link)) as session:
            topic = key(link.robot, f"{stage}/health")
            session.declare_subscriber(topic, lambda sample: arrived.put(sample.payload.to_bytes()))
            return decode(arrived.get(timeout=wait_s), Health).stage == stage
    except (zenoh.ZError, queue.Empty, CodecError):
        return False


if __name__ == "__main__":
    sys.exit(0 if is_alive(sys.argv[1], load_settings().link) else 1)
