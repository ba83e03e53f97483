"""The 3D view: viser's client, scenes of previews and folds, and pages that work without a server.

Programs and notebooks show folds with ``show``:

    from planner import fold
    from web.viser import show

    show(fold(shape))
    fold(shape, progress=show.live())
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from web.viser.show_fold import Live, Show, show
    from web.viser.viewer import Shown

__all__ = ["Live", "Show", "Shown", "show"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from web.viser import show_fold  # imported late, because pages do not need it

    return getattr(show_fold, name)
