"""Limits of a search: explosions, seeds and playbacks that a fold may take."""

from __future__ import annotations

from typing import Final

MAX_EXPLOSIONS: Final = 6
"""Maximum number of times that one fold explodes its chain (simulates how the folded chain comes
loose and straightens). A larger value folds more shapes, and takes longer to fail. Chosen."""
MAX_SEEDS: Final = 3
"""Maximum number of seeds of the random forces with which one fold tries to explode its chain. A
larger value folds more shapes, and takes longer to fail. Chosen."""
MAX_REFUSED_EXPLOSIONS: Final = 4
"""Maximum number of explosions of one fold whose plans all fail certification, before the fold
fails. A larger value folds more shapes, and takes longer to fail. Chosen."""
MAX_PLAYBACKS_BEFORE_VERIFIED: Final = 6
"""Maximum number of plans of one fold that are played back and certified (checked for collisions
and limits) as long as none passes. A larger value folds more shapes, and takes longer to fail.
Chosen."""
MAX_PLAYBACKS: Final = 12
"""Maximum number of plans of one fold that are played back and certified, including those that
improve a verified plan. A larger value finds better plans and takes longer. Chosen."""
REPEATED_PLAYBACK_REFINEMENT: Final = 4
"""Factor by which the number of frames increases when a playback is repeated because its clearance
between two frames was not proved. Larger values prove more plans and take longer. Chosen."""
