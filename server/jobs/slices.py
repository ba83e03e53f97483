"""Slices: time that a fold computes before it is paused for others that wait.

After its first slice a fold is paused for cheaper ones; after several times its expected cost, for
any other. It continues as long as none waits. A paused fold goes back to the queue, and its next
slice is several times as long, so that less than half of its computing time is wasted. It then
repeats the interrupted stage, but not the stages before it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from foldback.server.store.folds import Store
from foldback.server.store.schema import passes

SLICE_POLL_S: Final = 0.5
"""Time between two checks of a running fold if another fold in the queue should be computed
instead, in s."""


class Slice:
    """Time slice of one execution of a fold; it starts with its construction.

    Args:
        store: Rows of the folds.
        fold_id: The fold.
        epoch: Epoch of the execution.
        clock: Monotonic clock in seconds.
    """

    def __init__(
        self, store: Store, fold_id: str, epoch: int, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._store = store
        self._fold_id = fold_id
        self._epoch = epoch
        self._clock = clock
        self._started_at = clock()
        first_s, self._whole_s = store.slices_s(fold_id)
        self._look_at = self._started_at + first_s
        self.ended = False
        """True once ``over`` has returned True."""

    def over(self) -> bool:
        """Return True once the fold must be paused for another one."""
        now = self._clock()
        if not self.ended and now >= self._look_at:
            self._look_at = now + SLICE_POLL_S
            spent_s = now - self._started_at
            cheaper = spent_s < self._whole_s
            try:
                self.ended = self._store.others_wait(
                    self._fold_id, spent_s=spent_s, cheaper=cheaper
                )
            except SQLAlchemyError as error:
                if not passes(error):
                    raise
        return self.ended

    def pause(self) -> bool:
        """Put the fold back into the queue; return False if it is cancelled or taken over."""
        return self._store.pause(
            self._fold_id, self._epoch, spent_s=self._clock() - self._started_at
        )
