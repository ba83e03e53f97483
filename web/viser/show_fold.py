"""Show: a plan, a fold's directory or a timeline in viser, for programs and notebooks."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path as FilePath
from typing import Final

from foldback.planner.errors import InputError, TimelineError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.fold_layout import is_on_table, result_path
from foldback.planner.plan.plan import Plan
from foldback.planner.progress import STAGES, Progress
from foldback.planner.storage.array_files import HEAD
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.verification.plan_parameters import is_on_table as plan_on_table
from foldback.planner.verification.stored_fold import check_fold
from foldback.web.timeline.shared_views import TimelineViews
from foldback.web.timeline.view import MotionMoments, MotionSource, TimelineView
from foldback.web.viser.viewer import Shown

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_PORT: Final = 8080
"""Default TCP port of the web server that shows a fold from Python; if it is occupied, the next
free one is used. Viser's default."""
LAST_STAGE: Final = STAGES[-1]


class Live(Shown):
    """A fold that is shown while it is computed: pass it to ``foldback.fold`` as ``progress``.

    The fold needs a ``directory``, to which it writes its frames. The newest frame is shown until a
    viewer moves the slider back. When the fold ends, all frames stay in memory, because the fold's
    directory may be deleted. One object can show several folds, one after the other.
    """

    def __init__(self, *, host: str, port: int, open_browser: bool) -> None:
        """Start the server without a fold; ``show.live`` calls this."""
        self._views = TimelineViews()
        self._directory: FilePath | None = None
        self._finished_plan: MotionSource | None = None
        self._with_table = False
        super().__init__(
            self._newest,
            lambda: self._with_table,
            host=host,
            port=port,
            open_browser=open_browser,
            follows=True,
        )

    def __call__(self, progress: Progress) -> None:
        """Show the progress of the fold.

        Raises:
            InputError: ``no-directory`` if the fold writes no frames.
        """
        if progress.directory is None:
            raise InputError(
                "no-directory",
                "got a fold that is computed in memory, expected one that writes its frames; pass "
                "a directory as well: fold(shape, directory='wrench', progress=show.live()).",
            )
        directory = FilePath(progress.directory)
        if progress.stage == LAST_STAGE and progress.fraction >= 1.0:
            motion = self._finished_plan
            with suppress(TimelineError):  # nothing can be shown, but the fold goes on
                timeline = Timeline.open(result_path(directory, TIMELINE))
                motion = MotionMoments(timeline.chain, timeline.motion(), timeline.id)
            with self._lock:  # so that heading and frames change together
                self._finished_plan, self._directory, self._with_table = (
                    motion,
                    None,
                    is_on_table(directory),
                )
                self._controls.heading = "Done"
                if not self._closed:
                    self._look()
            return
        with self._lock:
            if directory != self._directory:
                self._directory, self._finished_plan, self._with_table = (
                    directory,
                    None,
                    is_on_table(directory),
                )
            stage_text = progress.stage.replace("_", " ").capitalize()
            self._controls.heading = f"{stage_text}, {progress.fraction:.0%}"

    @property
    def _growing(self) -> bool:
        return self._finished_plan is None  # also between two attempts

    def _newest(self) -> MotionSource | None:
        if self._finished_plan is not None or self._directory is None:
            return self._finished_plan
        return self._views.get(result_path(self._directory, TIMELINE))


class Show:
    """Type of ``show``: ``show(plan)`` shows a plan, ``show.live()`` a fold being computed."""

    def __call__(
        self,
        fold: Plan | Timeline | str | FilePath,
        *,
        port: int = DEFAULT_PORT,
        host: str = DEFAULT_HOST,
        open_browser: bool = False,
    ) -> Shown:
        """Show a fold in a viser server of its own.

        Args:
            fold: A plan, the directory of a fold, a timeline, or its path. While the timeline of a
                directory or path grows, new frames are shown, too.
            port: Port to listen on; the next free one if it is in use, any free one if 0.
            host: Address to listen on. viser has no authentication: everybody who can reach the
                address can view the fold and move the slider.
            open_browser: True to open a browser.

        Raises:
            TimelineError: If there is no timeline.
            InputError: ``no-frames`` for a plan without frames, ``no-such-address``; see
                ``planner.verification.stored_fold.check_fold`` for a directory.
        """
        if isinstance(fold, Plan):
            if not len(fold.motion):
                raise InputError(
                    "no-frames",
                    f"got a plan of {fold.chain.name} that has no frames, expected at least one "
                    "frame; pass the fold's directory instead to see its recorded frames.",
                )
            motion = MotionMoments(fold.chain, fold.motion)
            on_table = plan_on_table(fold)
            return Shown(
                lambda: motion, lambda: on_table, host=host, port=port, open_browser=open_browser
            )
        place = FilePath(fold.path if isinstance(fold, Timeline) else fold)
        views = TimelineViews()

        is_complete = (place / HEAD).exists()
        if not is_complete:
            check_fold(place)

        def now() -> TimelineView | None:
            return views.get(place if is_complete else result_path(place, TIMELINE))

        if now() is None:
            raise TimelineError(
                f"got {place}, which contains no timeline, expected the directory of a fold."
            )
        on_table = is_on_table(place.parent if is_complete else place)
        return Shown(now, lambda: on_table, host=host, port=port, open_browser=open_browser)

    def live(
        self, *, port: int = DEFAULT_PORT, host: str = DEFAULT_HOST, open_browser: bool = False
    ) -> Live:
        """Show a fold while it is computed.

        For example: ``fold(shape, directory="wrench", progress=show.live())``.

        Args:
            port, host, open_browser: Same as for ``show``.

        Raises:
            InputError: ``no-such-address``.
        """
        return Live(host=host, port=port, open_browser=open_browser)


show: Final = Show()
"""Shows a plan, a fold's directory or a timeline: see ``Show``."""
