"""Viewer: a plan, a fold's directory or a timeline in viser, for programs and notebooks.

    from foldback import fold
    from foldback.viewer import show

    show(fold(shape))
    fold(shape, directory="wrench", progress=show.live())

It needs viser: ``pip install 'foldback[viewer]'``.
"""

from importlib.util import find_spec

if find_spec("viser") is None:
    raise ImportError("foldback.viewer needs viser: pip install 'foldback[viewer]'")

from foldback.web.viser.show_fold import Live, Show, show
from foldback.web.viser.viewer import Shown

__all__ = ["Live", "Show", "Shown", "show"]
