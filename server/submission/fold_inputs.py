"""Fold inputs: sources of folds, and completion of the request by each kind of source."""

from __future__ import annotations

import json
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final

from fastapi import File, Form, UploadFile

from foldback.planner.chain.built_in_modules import module_of
from foldback.planner.chain.display_names import clean_name
from foldback.planner.pathfinding.path_options import MODULE_CHOICES, PathOptions
from foldback.planner.pipeline.request import FoldRequest, PreviewRequest
from foldback.planner.readers.formats import MESH_SUFFIXES
from foldback.planner.readers.limits import quote
from foldback.planner.storage.file_names import INPUT, PREPARED, REQUEST
from foldback.planner.storage.files import json_of
from foldback.planner.verification.integrity import check
from foldback.server.context import Context
from foldback.server.dependencies.owner_tokens import not_owner
from foldback.server.errors import NotFound, Unusable
from foldback.server.files.preview_reports import read_report
from foldback.server.schemas import MAX_FOLD_NAME
from foldback.server.store.owner import Owner
from foldback.server.store.previews import NoSuchPreviewError
from foldback.server.store.schema import FoldRow
from foldback.server.submission.parent_folds import ParentFold, finished_parent, stored_parent

OPTIONAL_ID: Final = "^[A-Za-z0-9_-]*$"
Cells = list[list[int]]
Uploaded = Annotated[UploadFile | None, File(description="A mesh, voxels, a path or a chain.")]
GalleryShape = Annotated[
    str | None, Form(description="Instead of a file: the name of a gallery shape.")
]


def id_field(description: str) -> Any:
    """Return the form field of the id of a fold or a preview."""
    return Form(max_length=64, pattern=OPTIONAL_ID, description=description)


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Input of a fold, as stated in the fields of a form; validated by ``check``.

    Attributes:
        file: An upload.
        shape: Name of a gallery shape.
        preview: Id of a preview.
        fold: Id of a fold whose input is used again.
        refold: Id of the fold that a refold starts from; combines with any other field.
        smooth: Id of a fold whose plan is smoothed.
    """

    file: Uploaded = None
    shape: GalleryShape = None
    preview: Annotated[str | None, id_field("Instead of a file: the id of a preview.")] = None
    fold: Annotated[
        str | None,
        id_field(
            "Instead of a file: the id of a fold whose input and shape options are used again."
        ),
    ] = None
    refold: Annotated[
        str | None,
        id_field(
            "Id of a finished fold. Its chain unfolds and then folds into the shape of this "
            "request, which must have the same number of modules of the same kind."
        ),
    ] = None
    smooth: Annotated[
        str | None,
        id_field(
            "Instead of a shape: the id of a verified fold. The new fold makes the motion of "
            "that fold shorter and smoother. Preset and strategy do not apply, because there is "
            "no new explosion."
        ),
    ] = None

    def check(self) -> None:
        """Check that there is exactly one input.

        Raises:
            Unusable: If there is none or several (``file-or-shape``, ``smooth-or-refold``).
        """
        names = [field.name for field in fields(self) if field.name != "refold"]
        set_names = [name for name in names if getattr(self, name) is not None]
        if len(set_names) != 1:
            raise Unusable(
                "file-or-shape",
                f"got {' and '.join(set_names) or 'none'} of the form fields 'file', 'shape', "
                "'preview', 'fold' and 'smooth', expected exactly one of them.",
                fields=set_names,
            )
        if self.smooth is not None and self.refold is not None:
            raise Unusable(
                "smooth-or-refold",
                "got both form fields 'smooth' and 'refold', expected one of them.",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Input of a new fold, and the request that it completes.

    Attributes:
        request: Request with the name of the input.
        shape: Name of the gallery shape; None for other inputs.
        cells: Cells for a first drawing on the fold's page; None if unknown.
        prepared: File with the chains that a preview has computed, or None.
        parent: Fold that it refolds or smooths, or None.
        repeats: Fold whose input is used again, or None.
    """

    request: FoldRequest
    shape: str | None = None
    cells: Cells | None = None
    prepared: Path | None = None
    parent: ParentFold | None = None
    repeats: FoldRow | None = None

    @property
    def public(self) -> bool:
        """True for a gallery fold: a gallery shape with default options."""
        return self.shape is not None and self.parent is None and not self.request.changed()


@contextmanager
def open_source(
    context: Context, origin: Origin, request: FoldRequest
) -> Generator[tuple[BinaryIO, Source]]:
    """Open the input that a form names, and complete a valid request by it.

    Raises:
        NoSuchFoldError: If there is no such fold.
        NoSuchPreviewError: If the preview no longer exists.
        ServiceError: If the input cannot be used.
    """
    with open_input(context, origin) as (stream, filename):
        source = Source(request=replace(request, filename=filename))
        if origin.shape is not None:
            source = _of_gallery(source, origin.shape)
        elif origin.preview is not None:
            source = _of_preview(context, source, origin.preview)
        elif (earlier := origin.smooth or origin.fold) is not None:
            source = _of_fold(context, source, earlier, smooth=origin.smooth is not None)
        if (parent := _parent(context, origin, source.repeats)) is not None:
            source = _derived(source, parent, origin)
        yield stream, replace(source, request=source.request.canonical())


@contextmanager
def open_input(context: Context, origin: Origin) -> Generator[tuple[BinaryIO, str | None]]:
    """Open the input that a form names; yield it and the name of its file.

    Raises:
        NoSuchFoldError: If there is no such fold.
        NoSuchPreviewError: If the preview no longer exists.
        ServiceError: If the input cannot be used.
    """
    origin.check()
    stream, filename = _opened(context, origin)
    with stream:
        yield stream, filename


def _opened(context: Context, origin: Origin) -> tuple[BinaryIO, str | None]:
    """Return the open input and its name."""
    if origin.file is not None:
        return origin.file.file, clean_filename(origin.file.filename)
    if origin.preview is not None:
        return _opened_preview(context, origin.preview)
    if (earlier := origin.smooth or origin.fold) is not None:
        context.store.fold(earlier)
        return stored_input(context.store.directory(earlier))
    name = origin.shape or ""
    gallery_shape = context.gallery.shape(name)
    if gallery_shape is None:
        raise Unusable(
            "no-such-shape",
            "got the shape {shape!r}, expected one of {nearest}; GET /api/shapes lists them.",
            shape=quote(name),
            nearest=context.gallery.nearest(name[:100]),
        )
    return BytesIO(gallery_shape.data), gallery_shape.filename


def _opened_preview(context: Context, preview_id: str) -> tuple[BinaryIO, str | None]:
    """Return the open upload of a preview and its name."""
    path = context.previews.directory(preview_id) / INPUT
    try:
        return open(path, "rb"), context.previews.row(preview_id).filename
    except FileNotFoundError as error:  # it has just been deleted
        raise NoSuchPreviewError(preview_id) from error


def _of_gallery(source: Source, shape: str) -> Source:
    """Complete the source of a gallery shape, whose own path is not suitable for a table."""
    on_table = source.request.world == "table"
    request = replace(source.request, as_voxels=source.request.as_voxels or on_table)
    return replace(source, request=request, shape=shape)


def _of_preview(context: Context, source: Source, preview_id: str) -> Source:
    """Complete the source of a preview with the cells and chains that it has computed."""
    place = context.previews.place(preview_id, PreviewRequest.of_fold(source.request).key)
    report, prepared = read_report(place), place / PREPARED
    fills_cells = report is not None and module_of(report["module_value"]).fills_cell
    return replace(
        source,
        cells=report["cells"] if report is not None and fills_cells else None,
        prepared=prepared if prepared.is_file() else None,
    )


def _of_fold(context: Context, source: Source, fold_id: str, *, smooth: bool) -> Source:
    """Complete the source of an earlier fold, whose path options are used again.

    The world is not taken over. A smoothing has the module size of its fold by default.
    """
    row, directory = context.store.fold(fold_id), context.store.directory(fold_id)
    request, cells = source.request, _stored_cells(directory)
    options = PathOptions.from_json(_stored_request(directory))
    if request.world == "table" != row.world:
        # The path of a floating chain is not used; a mesh still gets 2×2×2 modules per voxel.
        mesh = cells is None or (request.filename or "").lower().endswith(MESH_SUFFIXES)
        method = "blocks" if mesh and options.method == "auto" else "auto"
        options = replace(options, as_voxels=True, method=method)
    request = replace(request, **{**asdict(options), "world": request.world})
    request.check()
    if smooth and request.module_size is None:
        request = replace(request, module_size=row.module_size)
    repeats = None if smooth else row
    return replace(source, request=request, shape=row.shape, cells=cells, repeats=repeats)


def _parent(context: Context, origin: Origin, repeats: FoldRow | None) -> ParentFold | None:
    """Return the fold that is refolded or smoothed, or None."""
    if origin.smooth is not None:
        return finished_parent(context, origin.smooth, "smooth")
    if origin.refold is not None:
        return finished_parent(context, origin.refold, "refold")
    if repeats is not None:
        return stored_parent(context.store.directory(repeats.id), repeats)
    return None


def _derived(source: Source, parent: ParentFold, origin: Origin) -> Source:
    """Complete a source by its parent; a refold into a new input has the parent's modules."""
    request, use = source.request, parent.use
    if origin.refold is not None and (origin.file is not None or origin.preview is not None):
        modules = request.modules or parent.modules
        # Other modules come only in files, which describe them.
        module = parent.module if parent.module in MODULE_CHOICES else request.module
        request = replace(request, module=module, modules=modules)
    request = replace(request, refold=use == "refold", smooth=use == "smooth")
    return replace(source, request=request, parent=parent)


def clean_filename(name: str | None) -> str | None:
    """Return the last part of an upload's file name, fit to be shown; None if nothing is left."""
    last = (name or "").replace("\\", "/").rpartition("/")[2]
    return clean_name(last, max_length=MAX_FOLD_NAME) or None


def stored_input(directory: Path) -> tuple[BinaryIO, str | None]:
    """Return the input of a fold, open, and the name of its file.

    Raises:
        NotFound: If it no longer exists.
        DamagedError: If it is damaged.
    """
    try:
        source = open(directory / INPUT, "rb")  # noqa: SIM115 (the caller closes it)
    except OSError as error:
        raise _no_input() from error
    try:
        check(directory, INPUT, REQUEST)
        return source, _stored_request(directory)["filename"]
    except BaseException:
        source.close()
        raise


def check_readable(row: FoldRow, owner: Owner | None) -> None:
    """Refuse to show the input of a fold to anyone but its owner, except for a gallery shape.

    Raises:
        Forbidden: If the input is a file of another owner.
    """
    if row.shape is None and row.owner and not (owner and owner.owns(row.owner)):
        raise not_owner("Only the owner of this fold can see its file again.")


def stored_options(directory: Path) -> FoldRequest:
    """Return the request of a fold.

    Raises:
        NotFound: If it no longer exists.
    """
    return FoldRequest.from_json(_stored_request(directory))


def _stored_request(directory: Path) -> dict[str, Any]:
    """Return the values of a fold's request.

    Raises:
        NotFound: If they no longer exist.
    """
    request = json_of(directory / REQUEST)
    if "filename" not in request:
        raise _no_input()
    return request


def _stored_cells(directory: Path) -> Cells | None:
    """Return a fold's cells for a drawing, or None."""
    try:
        return json.loads((directory / "cells.json").read_bytes())
    except (OSError, ValueError):
        return None


def _no_input() -> NotFound:
    return NotFound("no-input", "The input file of this fold has expired; send the file again.")
