"""Slices: time that a fold computes before it makes room for others that wait.

After a first slice a fold makes room for cheaper ones, after several times its expected cost for
any. It goes on for as long as none waits. Otherwise it goes back to the queue, and its next slice
is several times as long: less is computed in vain than in the end. It then begins the stage again
that was cut off; the stages before it are not repeated.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from server.store.folds import Store
from server.store.tables import passes

SLICE_POLL_S: Final = 0.5
"""Time between two checks of a running fold if another fold in the queue should be computed
instead, in s. With a larger value other folds wait longer; a smaller one reads the database more
often. Chosen."""


class Slice:
    """Time slice of one execution of a fold; it starts with its construction.

    Args:
        store: Rows of the folds.
        fold_id: The fold.
        epoch: Epoch of the execution.
        clock: Seconds that only rise.
    """

    def __init__(
        self, store: Store, fold_id: str, epoch: int, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._store = store
        self._fold_id = fold_id
        self._epoch = epoch
        self._clock = clock
        self._begun = clock()
        first_s, self._whole_s = store.slices_s(fold_id)
        self._look_at = self._begun + first_s
        self.ended = False
        """True once ``over`` has returned True."""

    def over(self) -> bool:
        """Return True once the fold has to make room for another one."""
        now = self._clock()
        if not self.ended and now >= self._look_at:
            self._look_at = now + SLICE_POLL_S
            spent_s = now - self._begun
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
        """Put the fold back into the queue; False if it is cancelled or not ours any more."""
        return self._store.pause(self._fold_id, self._epoch, spent_s=self._clock() - self._begun)
