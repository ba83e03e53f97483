"""What all tests share."""

from __future__ import annotations

import pytest
from hypothesis import settings

from tests import progress

# No test asserts wall-clock time, so hypothesis must not either.
settings.register_profile("foldback", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("foldback")


def pytest_configure(config: pytest.Config) -> None:
    """Runs on several processes tell how far they are."""
    progress.add_to(config)
