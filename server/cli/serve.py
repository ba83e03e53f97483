"""``foldback serve``: starts the web process and the workers."""

from __future__ import annotations

import logging
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foldback.server.errors import READ_ONLY_WORDS
from foldback.server.limits.open_files import BACKLOG, OpenFiles
from foldback.server.ops.logs import set_up_logs
from foldback.server.ops.startup_errors import settings_of, starting, warn_of_unknown_names
from foldback.server.ops.stop_signals import on_stop_signals
from foldback.server.processes.limits import keep_secrets

log = logging.getLogger("foldback.serve")

if TYPE_CHECKING:
    import uvicorn

    from foldback.server.context import Context
    from foldback.server.settings import Settings


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 0 picks a free one.")] = None,
    data_dir: Annotated[Path | None, typer.Option(help="Data directory of the service.")] = None,
    workers: Annotated[int | None, typer.Option(help="Number of worker processes.")] = None,
    first_shape: Annotated[
        str | None,
        typer.Option(help="Gallery shape to fold at start, unless it has been folded already."),
    ] = None,
) -> None:
    """Start the service. Environment variables such as FOLDBACK_PORT configure it."""
    keep_secrets()
    settings = settings_of(host=host, port=port, data_dir=data_dir, workers=workers)
    set_up_logs(settings)
    warn_of_unknown_names(log)

    # Workers start first: they load libraries on another core while the web process does.
    from foldback.server.ops.supervisor import Supervisor

    with starting("service"):
        settings.make_directories()
    supervisor = Supervisor(settings)
    if not settings.read_only:
        supervisor.start()
    try:
        _run(settings, first_shape)
    finally:
        supervisor.stop()


def _run(settings: Settings, first_shape: str | None) -> None:
    settings, files = _within_open_files(settings)
    server = server_of(settings, first_shape, backlog=files.backlog)
    # Threads that compute a response yield to the event loop after this time instead of 5 ms. With
    # a hundred visitors this halves the waiting times of others.
    sys.setswitchinterval(0.0005)
    try:
        server.run()
    except SystemExit:  # the port is in use or the application did not start; already logged
        raise typer.Exit(1) from None


def server_of(
    settings: Settings, first_shape: str | None = None, *, backlog: int = BACKLOG
) -> uvicorn.Server:
    """Migrate the database and return an HTTP server that is not running yet.

    Args:
        settings: The settings.
        first_shape: Gallery shape to fold unless it has been folded already.
        backlog: Number of connections that may wait to be accepted.
    """
    import asyncio

    import uvicorn

    from foldback.server.admin.migration import run_migration
    from foldback.server.app import create_app
    from foldback.server.http.connections import protocol_of
    from foldback.server.store.object_store import open_storage

    if settings.read_only:
        log.error("%s Restart the service once %s can be written.", READ_ONLY_WORDS, settings.root)
    with starting("service"):
        open_storage(settings)
        run_migration(settings)
    app = create_app(settings)

    class Server(uvicorn.Server):
        """HTTP server that prints its address, and ends event streams before it stops.

        Until it has started, a stop signal ends the process at once.
        """

        @contextmanager
        def capture_signals(self) -> Generator[None]:
            """Leave the signals to their owner."""
            yield

        async def startup(self, sockets: list[Any] | None = None) -> None:
            await super().startup(sockets)
            if not self.started:
                return
            on_stop_signals(self.handle_exit)
            port = self.servers[0].sockets[0].getsockname()[1]
            host = f"[{settings.host}]" if ":" in settings.host else settings.host
            address = f"http://{host}:{port}{settings.base_path}"
            print(f"foldback is at {address}", flush=True)
            if first_shape is not None:
                context: Context = app.state.context
                fold_id = await asyncio.to_thread(_fold_first, context, first_shape)
                print(f"  {first_shape}: {address}/folds/{fold_id}", flush=True)

        async def shutdown(self, sockets: list[Any] | None = None) -> None:
            context: Context = app.state.context
            app.state.readiness.end()
            if self.started and not self.force_exit:
                await asyncio.sleep(settings.leave_s)
            context.fold_states.end()
            await super().shutdown(sockets)

    return Server(
        uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            backlog=backlog,
            log_level="warning",
            log_config=None,
            access_log=False,
            http=protocol_of(settings),
            h11_max_incomplete_event_size=32 * 1024,
            proxy_headers=False,  # see server.http.forwarded_address
            ws_max_size=2**20,
            # Websockets carry arrays many times per second, which compress poorly.
            ws_per_message_deflate=False,
            # Longer than clients keep idle connections (usually 5 s). If both close them at the
            # same time, some requests are sent on a connection that is just being closed.
            timeout_keep_alive=max(1, int(0.75 * settings.header_seconds)),
            timeout_graceful_shutdown=3,
            server_header=False,
        )
    )


def _within_open_files(settings: Settings) -> tuple[Settings, OpenFiles]:
    """Return the settings with as many connections as the limit of open files carries."""
    files = OpenFiles.take(settings)
    if files.connections < settings.max_connections:
        log.warning(
            "only %d connections instead of %d, because this process may open %d files at most; "
            "raise the limit (`ulimit -n`, LimitNOFILE= in a systemd unit)",
            files.connections,
            settings.max_connections,
            files.files,
        )
    return settings.model_copy(update={"max_connections": files.connections}), files


def _fold_first(context: Context, name: str) -> str:
    from foldback.planner.errors import InputError
    from foldback.planner.pipeline.request import FoldRequest
    from foldback.server.errors import Unusable
    from foldback.server.store.owner import Claim
    from foldback.server.submission.fold_inputs import Origin
    from foldback.server.submission.shipped_folds import SERVICE_VISITOR
    from foldback.server.submission.submit import fold_origin

    try:
        receipt = fold_origin(
            context,
            Origin(shape=name),
            FoldRequest(),
            visitor=SERVICE_VISITOR,
            owner=Claim.new().owner,
        )
    except (InputError, Unusable) as error:
        raise typer.BadParameter(error.detail) from None
    return receipt.row.id
