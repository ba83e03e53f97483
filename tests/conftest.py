"""What all tests share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests import progress
from tests.server.service import Service

# No test asserts wall-clock time, so hypothesis must not either.
settings.register_profile("foldback", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("foldback")


def pytest_configure(config: pytest.Config) -> None:
    """Runs on several processes tell how far they are."""
    progress.add_to(config)


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service with a worker, for all tests of this process: they meet each other's folds."""
    service = Service(tmp_path_factory.mktemp("service") / "data").start()
    yield service
    assert service.stop() == 0
