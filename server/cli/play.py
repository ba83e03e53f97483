"""``foldback play``: displays a fold's directory without a service."""

from __future__ import annotations

import contextlib
import signal
import threading
import webbrowser
from collections.abc import AsyncGenerator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Final, cast

import typer
import uvicorn
from fastapi import FastAPI
from fastapi.responses import RedirectResponse

from foldback.cli.exit_statuses import INVALID_INPUT
from foldback.cli.tour import stored_tour
from foldback.planner.certificate.figures import FoldSummary
from foldback.planner.chain.built_in_modules import described_words
from foldback.planner.chain.display_names import escaped
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.explosion.diagnosis import stuck_of
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.parameters import FLOATING
from foldback.planner.pipeline.derived_files import completed
from foldback.planner.pipeline.fold_layout import lacks_verdict, plan_values, result_path
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.module_values import values_in
from foldback.planner.reasons import Reason
from foldback.planner.storage.file_names import CERTIFICATE, PLAN, REQUEST, TIMELINE
from foldback.planner.storage.files import json_of
from foldback.planner.storage.plain_values import from_plain
from foldback.planner.verification.stored_fold import check_fold
from foldback.server.files.artifacts import Artifacts
from foldback.server.files.fold_figures import FoldFigures
from foldback.server.http.security import AllowedHosts, SameOrigin, SecurityHeaders, hosts_of
from foldback.server.pages import fold, player_data, share, static
from foldback.server.store.fold_source import LocatedFold
from foldback.server.viewing.fold_lookup import Viewing
from foldback.server.viewing.frame_waits import FrameWaits
from foldback.web.timeline.shared_views import TimelineViews
from foldback.words.fold import ShownFold

PLAYED_FOLD_ID: Final = "fold"


class FolderStore:
    """Fold source with a single fold, a directory."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def find(self, fold_id: str) -> LocatedFold | None:
        """Return the only fold if the id matches."""
        return (
            LocatedFold(self.fold(fold_id), self._directory) if fold_id == PLAYED_FOLD_ID else None
        )

    def tour(self, _fold_id: str) -> dict[str, Any] | None:
        """Return the tour in the directory; None if it is missing or invalid."""
        tour = stored_tour(self._directory)
        return None if tour is None else tour.as_dict()

    def values(self, fold_id: str) -> dict[str, Any] | None:
        """Return the module values in the directory; None if they are missing or invalid."""
        return values_in(self._directory, self.fold(fold_id).modules)

    def fold(self, _fold_id: str) -> ShownFold:
        """Return the facts of the fold."""
        return row_of(self._directory)


def row_of(directory: Path) -> ShownFold:
    """Return the row of a fold's directory.

    Raises:
        TimelineError: If it contains no timeline.
    """
    chain = Timeline.open(result_path(directory, TIMELINE)).chain
    request = json_of(directory / REQUEST)
    plan = plan_values(directory / PLAN)
    certificate = plan.get("certificate") or json_of(result_path(directory, CERTIFICATE))
    verified, reason = certificate.get("verified"), certificate.get("reason")
    no_plan = None if verified else "the fold has no plan"
    values: dict[str, Any] = {
        "status": "verified" if verified else "failed",
        "reason": from_plain(reason, Reason).text() if reason else no_plan,
        "certificate": certificate,
        **{k: plan[k] for k in ("explosion", "playback", "seed", "smoothing") if k in plan},
    }
    if plan:
        values["stuck"] = stuck_of(plan.get("explosion"), plan.get("attempts") or ())
    elif not certificate:
        values |= Workspace(directory).stopped_where()
    if plan.get("start"):
        values["refold"] = {"start": plan["start"]["name"]}
    return ShownFold(
        id=PLAYED_FOLD_ID,
        name=chain.name,
        status=values["status"],
        modules=len(chain),
        module=chain.module.name,
        module_words=described_words(chain.module),
        preset=str(request.get("preset") or plan.get("preset") or ""),
        settings=_settings(request.get("preset"), request.get("settings")),
        seed=int(request.get("seed", plan.get("seed")) or 0),
        module_size=request.get("module_size"),
        world=str(request.get("world") or FLOATING),
        refold=start["name"] if (start := plan.get("start")) else None,
        smooths=PLAYED_FOLD_ID if plan.get("smoothing") else None,
        summary=cast(FoldSummary, values),
    )


def create_player_app(directory: Path, host: str = "127.0.0.1") -> FastAPI:
    """Return an application that displays one directory."""
    store = FolderStore(directory)

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:
        # The directory belongs to the user, so exports are not written to it.
        with (
            TemporaryDirectory(prefix="foldback-") as place,
            contextlib.ExitStack() as opened,
        ):
            artifacts = Artifacts(None, folder=Path(place))
            waits = FrameWaits()
            figures = FoldFigures(lambda fold: opened.enter_context(completed(fold.directory)))
            verdicts = FoldFigures(
                lambda fold: opened.enter_context(completed(fold.directory, "verdict")),
                lacks=lacks_verdict,
            )
            app.state.context = Viewing(
                store=store,
                timelines=TimelineViews(),
                waits=waits,
                artifacts=artifacts,
                figures=figures,
                verdicts=verdicts,
                settings=None,
            )
            yield
            waits.close()
            artifacts.close()
            figures.close()
            verdicts.close()

    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None, lifespan=lifespan)

    @app.get("/")
    async def to_the_fold() -> RedirectResponse:
        return RedirectResponse(f"/folds/{PLAYED_FOLD_ID}")

    app.include_router(fold.router)
    app.include_router(static.router)
    app.include_router(player_data.router)
    app.include_router(share.router)
    app.add_middleware(SameOrigin)
    app.add_middleware(AllowedHosts, hosts=hosts_of(host))
    app.add_middleware(SecurityHeaders)
    return app


def play(
    directory: Annotated[Path, typer.Argument(help="Directory of a fold, with its timeline.")],
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 picks a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
    viser: Annotated[
        bool,
        typer.Option(
            "--viser",
            help="Show the fold on a page of viser, a 3D viewer, instead of foldback's page. "
            "All browsers that open the page of viser show the same frame.",
        ),
    ] = False,
) -> None:
    """Show a fold in the browser."""
    try:
        check_fold(directory)
        name = row_of(directory).name
        if viser:
            _play_in_viser(directory, name, host, port, browser)
            return
    except (TimelineError, InputError) as error:
        typer.echo(escaped(f"{error}"), err=True)
        raise typer.Exit(INVALID_INPUT) from error

    class Server(uvicorn.Server):
        """HTTP server that prints its address once it listens."""

        async def startup(self, sockets: list[Any] | None = None) -> None:
            await super().startup(sockets)
            if not self.started:
                return
            at = self.servers[0].sockets[0].getsockname()[1]
            address = f"http://{host}:{at}/folds/{PLAYED_FOLD_ID}"
            typer.echo(f"{name} is at {address} (Ctrl-C stops it)")
            if browser:
                threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    Server(
        uvicorn.Config(
            create_player_app(directory, host),
            host=host,
            port=port,
            log_level="warning",
            access_log=False,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=2,
        )
    ).run()


def _play_in_viser(directory: Path, name: str, host: str, port: int, browser: bool) -> None:
    """Show a fold in a viser server until SIGINT (Ctrl-C) or SIGTERM."""
    from foldback.viewer import show
    from foldback.web.viser.scene_bundle import quiet

    ended = threading.Event()
    # As in uvicorn; also needed if the shell has started this program with SIGINT ignored.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: ended.set())
    with quiet():
        address = show(directory, host=host, port=port, open_browser=browser)
    with address:
        typer.echo(f"{name} is at {address.url} (Ctrl-C stops it)")
        while not ended.wait(1.0):  # a signal to another thread does not wake this one
            pass


def _settings(preset: Any, settings: Any) -> str:
    """Return the settings of a fold; none if its file states impossible ones."""
    try:
        return FoldRequest(preset=str(preset), settings=str(settings or "")).canonical().settings
    except InputError:
        return ""
