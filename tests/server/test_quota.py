"""At most so much at once, in all and of one visitor; the rest waits for its turn."""

from __future__ import annotations

import pytest

from server.errors import TooMany
from server.limits.quota import Place, Quota


def test_places_come_back() -> None:
    quota = Quota("event streams", total=3, per_visitor=2)
    first, _ = quota.enter("a"), quota.enter("a")
    with pytest.raises(TooMany, match="2 event streams of yours") as refused:
        quota.enter("a")
    assert (refused.value.code, refused.value.retry_after_s) == ("too-many-streams", 10)
    with quota.enter("b"), pytest.raises(TooMany, match="3 event streams in all"):
        quota.enter("c")
    first.leave()
    assert len(quota) == 1
    quota.enter("a")


def test_whoever_is_no_visitor_is_bounded_with_all_others() -> None:
    quota = Quota("connections", total=None, per_visitor=1)
    assert [quota.enter(None) for _ in range(3)]
    quota.enter("a")
    with pytest.raises(TooMany):
        quota.enter("a")


def test_visitors_take_turns_and_who_leaves_the_line_has_none() -> None:
    begun: list[Place] = []
    quota = Quota("files", total=9, per_visitor=9, at_once=2, at_once_per_visitor=1)
    a1, a2, a3, b1, b2 = (quota.enter(who, begun.append) for who in "aaabb")
    assert begun == [a1, b1]
    b2.leave()
    b1.leave()  # those of a wait all the same: one of them goes on
    assert begun == [a1, b1]
    c1 = quota.enter("c", begun.append)
    a1.leave()
    assert begun == [a1, b1, c1, a2]
    a2.leave()
    assert (begun[-1], len(quota)) == (a3, 2)
