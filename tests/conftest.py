"""What all tests share."""

from __future__ import annotations

from hypothesis import settings

# No test asserts wall-clock time, so hypothesis must not either.
settings.register_profile("foldback", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("foldback")
