"""What the first visitors would wait for can be loaded before they come."""

from __future__ import annotations

from server.pages import landing
from server.store.gallery import Gallery


def test_what_pages_need_is_there() -> None:
    landing.warm_up(Gallery())
