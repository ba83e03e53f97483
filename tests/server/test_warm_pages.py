"""What the first visitors would wait for can be loaded before they come."""

from __future__ import annotations

from server.gallery import Gallery
from server.routes import pages


def test_what_pages_need_is_there() -> None:
    pages.warm_up(Gallery())
