"""What several system tests meet at."""

from collections.abc import Iterator

import pytest
import zenoh

from spot3d.dataflow.router import free_loopback_endpoint, open_router


@pytest.fixture(scope="module")
def router() -> Iterator[tuple[zenoh.Session, str]]:
    """A router, and where it listens."""
    endpoint = free_loopback_endpoint()
    with open_router((endpoint,)) as session:
        yield session, endpoint
