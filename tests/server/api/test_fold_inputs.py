"""Sources: a fold's request is completed from its input, without a service."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.readers.gallery import Gallery
from foldback.server.api.folds import post_fold
from foldback.server.context import Context
from foldback.server.errors import Unusable
from foldback.server.store.schema import FoldRow
from foldback.server.submission import fold_inputs as source_module
from foldback.server.submission.fold_inputs import Origin, Source, open_source
from foldback.server.submission.parent_folds import ParentFold
from tests.case import case
from tests.refusal import refused


class Upload:
    """Uploaded file, which ``open_source`` closes."""

    filename = "a/cup.stl"

    @property
    def file(self) -> BytesIO:
        return BytesIO(b"solid")


FILE = cast(Any, Upload())
TABLE = FoldRequest(world="table")
PARENT = ParentFold(
    use="refold", fold=None, name="Cup", module="tetrahedron", modules=48, files={}, digest="d"
)


@pytest.fixture
def context(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Context:
    """Context of ``open_source``: the gallery, and folds whose files are in a directory."""
    folds = {
        "mesh": FoldRow(id="mesh", shape=None, module_size=0.9, world="floating"),
        "voxels": FoldRow(id="voxels", shape="mallet-64", module_size=None, world="floating"),
        "rests": FoldRow(id="rests", shape=None, module_size=None, world="table"),
    }
    for name in folds:
        (tmp_path / name).mkdir()
        (tmp_path / name / "input").write_bytes(b"input")
        filename = "cup.stl" if name == "mesh" else "cup.json"
        request = {"filename": filename, "repair": True, "seed": 5, "world": folds[name].world}
        (tmp_path / name / "request.json").write_text(json.dumps(request))
    for name in ("voxels", "rests"):
        (tmp_path / name / "cells.json").write_text("[[0, 0, 0]]")
    monkeypatch.setattr(source_module, "check", lambda *_: None)
    monkeypatch.setattr(
        source_module, "finished_parent", lambda _context, _id, use: replace(PARENT, use=use)
    )
    monkeypatch.setattr(source_module, "stored_parent", lambda _directory, _row: None)
    store = SimpleNamespace(fold=folds.__getitem__, directory=lambda name: tmp_path / name)
    return cast(Context, SimpleNamespace(gallery=Gallery(), store=store))


def complete_request(context: Context, origin: Origin, request: FoldRequest) -> Source:
    with open_source(context, origin, request) as (stream, source):
        assert not stream.closed
    return source


def test_input_completes_the_request(context: Context) -> None:
    plain, table, flat = FoldRequest(), {"world": "table"}, {"world": "table", "as_voxels": True}
    refolded = Origin(file=FILE, refold="x")
    for origin, request, expected in (
        # A path for zero gravity is unsuitable for a table; a mesh gets 2×2×2 modules as before.
        (Origin(shape="mallet-64"), TABLE, flat),
        (Origin(shape="mallet-64"), plain, {}),
        (Origin(fold="mesh"), TABLE, {**flat, "method": "blocks", "repair": True}),
        (Origin(fold="voxels"), TABLE, {**flat, "repair": True}),
        (Origin(fold="rests"), TABLE, {**table, "repair": True}),
        # World and seed always come from the new request.
        (Origin(fold="rests"), FoldRequest(seed=2), {"repair": True, "seed": 2}),
        # A smoothing has the module size of its fold, unless another one is requested.
        (Origin(smooth="mesh"), plain, {"repair": True, "module_size": 0.9}),
        (Origin(smooth="mesh"), FoldRequest(module_size=0.8), {"repair": True, "module_size": 0.8}),
        # A new input is made of the modules of the fold from which a refold starts.
        (refolded, plain, {"module": "tetrahedron", "modules": 48}),
        (refolded, FoldRequest(modules=50), {"module": "tetrahedron", "modules": 50}),
        (Origin(shape="mallet-64", refold="x"), plain, {}),
        (Origin(file=FILE), plain, {}),
    ):
        with case((origin, request)):
            source = complete_request(context, origin, request)
            assert source.request.changed() == expected
            assert source.request.smooth == (origin.smooth is not None)
            assert source.request.refold == (origin.refold is not None)
            assert (source.repeats is not None) == (origin.fold is not None)


def test_filename_is_the_last_part_of_its_path(context: Context) -> None:
    assert complete_request(context, Origin(file=FILE), FoldRequest()).request.filename == "cup.stl"


def test_only_gallery_shapes_with_default_options_are_public(context: Context) -> None:
    for origin, request, public in (
        (Origin(shape="mallet-64"), FoldRequest(), True),
        (Origin(shape="mallet-64"), FoldRequest(seed=1), False),
        (Origin(shape="mallet-64"), FoldRequest(settings="robots=5"), False),
        (Origin(shape="mallet-64", refold="x"), FoldRequest(), False),
        (Origin(smooth="voxels"), FoldRequest(), False),
    ):
        assert complete_request(context, origin, request).public == public, origin


def test_origin_without_one_input_is_refused(context: Context) -> None:
    for origin, code in (
        (Origin(), "file-or-shape"),
        (Origin(refold="x"), "file-or-shape"),
        (Origin(shape="mallet-64", fold="mesh"), "file-or-shape"),
        (Origin(smooth="mesh", refold="x"), "smooth-or-refold"),
        (Origin(shape="no-such"), "no-such-shape"),
    ):
        with case(origin), refused(code, kind=Unusable):
            complete_request(context, origin, FoldRequest())


def test_bad_option_is_refused_before_the_input_is_looked_up() -> None:
    nothing = cast(Any, None)  # no context is needed
    request = FoldRequest(world="table", preset="paper")
    with refused("unsuited-world"):
        post_fold(nothing, nothing, nothing, Origin(fold="no-such-fold"), request)
