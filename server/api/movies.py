"""Routes of movies: request, progress, download, cancel."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final, Literal, cast

import msgspec
from fastapi import APIRouter, Depends, Request
from fastapi.responses import FileResponse, Response
from msgspec import Meta

from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.verification.integrity import check
from foldback.server.context import Here
from foldback.server.dependencies.described_answers import file_or_problems, problems
from foldback.server.dependencies.owner_tokens import AnyClaim, OptionalOwner, not_owner
from foldback.server.dependencies.request_bodies import described, json_body
from foldback.server.dependencies.requested_folds import existing_fold
from foldback.server.errors import Conflict, Unusable
from foldback.server.http.downloads import download
from foldback.server.processes.movie_task import movie_formats
from foldback.server.schemas import Body, Fault
from foldback.server.store.schema import MovieRow
from foldback.server.viewing.fold_lookup import with_figures
from foldback.server.viewing.fold_notes import tour_of
from foldback.web.movies.movie import Movie

router = APIRouter(prefix="/api/folds/{fold_id}/movies", tags=["movies"])
MOVIE_MEDIA_TYPES: Final = {"mp4": "video/mp4", "gif": "image/gif"}


MovieStatus = Literal["queued", "running", "ready", "failed"]
SHOWN_OPTIONS: Final = ("format", "width", "height", "fps", "seconds")
"""Options of a movie that its answer states."""


class MovieOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a movie; each format has defaults."""

    format: Literal["mp4", "gif"] = "mp4"
    width: Annotated[
        int | None,
        Meta(description="Width in pixels; must be an even number, at most 1920 (GIF: 960)."),
    ] = None
    height: Annotated[int | None, Meta(description="Height in pixels; must be an even number.")] = (
        None
    )
    fps: Annotated[int | None, Meta(description="Frames per second, at most 60 (GIF: 25).")] = None
    seconds: Annotated[
        float | None, Meta(description="Length in seconds, at most 60 (GIF: 20).")
    ] = None
    azimuth_deg: Annotated[
        float | None,
        Meta(
            description="Direction of the camera at the end: -90 is the front, 0 the right. "
            "Default: chosen from the shape."
        ),
    ] = None
    elevation_deg: Annotated[
        float | None, Meta(description="Angle of the camera above the ground.")
    ] = None
    turn_deg: Annotated[
        float | None, Meta(description="Angle through which the camera circles.")
    ] = None
    theme: Literal["light", "dark"] | None = None
    first_frame: Annotated[
        int | None, Meta(description="First frame. Default: the first frame of the playback.")
    ] = None
    last_frame: Annotated[
        int | None,
        Meta(
            description="Last frame. Default: the last frame of the fold. If it is before "
            "`first_frame`, the movie plays backwards."
        ),
    ] = None
    tour: Annotated[
        bool,
        Meta(description="True: rest at the stops of the fold's tour and show their captions."),
    ] = False


class MovieLinks(Body):
    """Links of a movie."""

    self: str
    file: str
    fold: str


class MovieBody(Body):
    """Current state of a movie."""

    id: str
    status: MovieStatus
    frames_done: int
    frames_total: int
    format: Literal["mp4", "gif"]
    width: int
    height: int
    fps: int
    seconds: float
    problem: Fault | None
    token: str | None = None
    """Token that deletes the movie: the token you sent, or a new one. Only the response
    to the first request for a movie contains it."""
    links: MovieLinks

    @classmethod
    def of(cls, row: MovieRow, token: str | None = None) -> MovieBody:
        """Return the API's representation of a movie."""
        movie_path = f"/api/folds/{row.fold_id}/movies/{row.id}"
        movie = Movie.of(row.wishes)
        return cls(
            id=row.id,
            status=cast("MovieStatus", row.status),
            frames_done=row.frames_done,
            frames_total=movie.count,
            **{name: getattr(movie, name) for name in SHOWN_OPTIONS},
            problem=Fault.model_validate(row.problem) if row.problem else None,
            token=token,
            links=MovieLinks(
                self=movie_path, file=f"{movie_path}/file", fold=f"/api/folds/{row.fold_id}"
            ),
        )


@router.post(
    "",
    status_code=202,
    summary="Create a movie",
    responses=problems(404, 409, 422, 429, 503, 507),
    dependencies=[Depends(existing_fold)],
    openapi_extra=described(MovieOptions),
)
async def post_movie(
    request: Request,
    response: Response,
    fold_id: str,
    context: Here,
    claim: AnyClaim,
    options: Annotated[MovieOptions, json_body(MovieOptions)],
) -> MovieBody:
    """Add a movie to the queue. The same options return the same movie.

    A fold keeps a limited number of movies: a new movie replaces the oldest finished one. A movie
    requested with the owner token is replaced only by a newer movie requested with this token.
    """
    located = await asyncio.to_thread(context.store.find, fold_id) if options.tour else None
    if located is not None:
        located = await with_figures(request, located)

    def ask() -> MovieBody:
        tour = None if located is None else tour_of(context.store, located)
        fields = msgspec.structs.asdict(options)
        del fields["tour"]
        movie = Movie.of(fields, tour)
        _check_format(movie.format)
        of_owner = context.store.owns(fold_id, claim.owner)
        visitor = context.visitor(request)
        row, new = context.movies.ask(fold_id, movie, visitor, owner=claim.owner, of_owner=of_owner)
        return MovieBody.of(row, claim.token if new else None)

    body = await asyncio.to_thread(ask)
    response.headers["Location"] = body.links.self
    _again(response, body)
    return body


@router.get("/{movie_id}", summary="Get the status of a movie", responses=problems(404))
def get_movie(response: Response, fold_id: str, movie_id: str, context: Here) -> MovieBody:
    """Return the status of a movie.

    Repeat the request after `Retry-After` seconds until the status is `ready` or `failed`.
    """
    context.store.fold(fold_id)
    body = MovieBody.of(context.movies.state(fold_id, movie_id))
    _again(response, body)
    return body


@router.get(
    "/{movie_id}/file",
    summary="Download a movie",
    response_class=FileResponse,
    responses=file_or_problems("The file", *MOVIE_MEDIA_TYPES.values(), problem=(404, 409)),
)
def get_movie_file(fold_id: str, movie_id: str, context: Here) -> FileResponse:
    """Return the MP4 or GIF file."""
    row = context.store.fold(fold_id)
    check(context.store.directory(fold_id), TIMELINE)
    path = context.movies.file(fold_id, movie_id)
    if path is None:
        raise Conflict(
            "not-ready", "The movie is not ready yet; try again in a moment.", retry_after_s=1
        )
    return download(path, MOVIE_MEDIA_TYPES[path.suffix[1:]], row.name, path.suffix)


@router.delete(
    "/{movie_id}",
    status_code=204,
    summary="Cancel or delete a movie",
    responses=problems(403, 404),
)
def delete_movie(fold_id: str, movie_id: str, context: Here, owner: OptionalOwner) -> Response:
    """Cancel or delete a movie.

    Send the token with which the movie was requested, or the owner token of the fold.
    """
    context.store.fold(fold_id)
    row = context.movies.state(fold_id, movie_id)
    if owner is None or not (owner.owns(row.token_hash) or context.store.owns(fold_id, owner)):
        raise not_owner(
            "This request needs the token that was returned when the movie was requested, or the "
            "token of the fold's owner, as 'Authorization: Bearer …'."
        )
    context.movies.delete(fold_id, movie_id)
    return Response(status_code=204)


def _check_format(file_format: str) -> None:
    """Check that this service can make movies of a format."""
    possible = movie_formats()
    if file_format in possible:
        return
    if not possible:
        raise Unusable("no-gl", "This service cannot draw movies, because it has no OpenGL.")
    raise Unusable(
        "no-encoder",
        "got mp4, but this service has no ffmpeg to encode it; expected gif.",
        where="format",
    )


def _again(response: Response, body: MovieBody) -> None:
    response.headers["Cache-Control"] = "no-store"
    if body.status in ("queued", "running"):
        response.headers["Retry-After"] = "1"
