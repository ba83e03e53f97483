"""Previews: what is answered, what is refused and kept, and that folds take the same options."""

from __future__ import annotations

import asyncio
import json
import shutil
import struct
import threading
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import httpx
import numpy as np
import pytest

from server.errors import Unavailable
from server.files.preview_scenes import MAX_PENDING_SCENES, SCENES_AT_ONCE, PreviewScenes
from server.settings import Settings
from server.store.folds import Store
from server.store.owner import new_token
from server.store.previews import NoSuchPreviewError, Previews
from server.store.tables import PreviewRow
from tests.server.service import PATIENCE_S, SNAKE, Service
from web.pictures.isometric import isometric_svg
from web.timeline.columns import decode

CROSS = [[1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 2, 0]]


def voxels(cells: object, **more: object) -> bytes:
    return json.dumps({"format": "foldback-voxels/1", "cells": cells, **more}).encode()


def box(*size: int) -> list[list[int]]:
    return np.argwhere(np.ones(size)).tolist()


def stl(*, hole: bool = False) -> bytes:
    """A box of 2 by 1 by 1, as a binary STL."""
    corners = np.argwhere(np.ones((2, 2, 2))) * np.array([2.0, 1.0, 1.0])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))][: 6 if hole else 12]
    rows = b"".join(
        struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces
    )
    return bytes(80) + struct.pack("<I", len(faces)) + rows


def ask(service: Service, data: bytes | None = None, /, **form: Any) -> httpx.Response:
    files = None if data is None else {"file": ("thing.bin", data)}
    return service.http.post("/api/shapes/preview", data=form, files=files)


def report(service: Service, data: bytes | None = None, /, **form: Any) -> dict[str, Any]:
    answer = ask(service, data, **form)
    assert answer.status_code == 200, answer.text
    return answer.json()


def is_path(cells: list[list[int]]) -> bool:
    steps = np.abs(np.diff(np.array(cells), axis=0)).sum(axis=1)
    return bool((steps == 1).all()) and len({tuple(c) for c in cells}) == len(cells)


def test_a_mesh_becomes_about_as_many_modules_as_asked_for(desk: Service) -> None:
    found = report(desk, stl(), modules="128")
    assert found["kind"] == "mesh"
    assert found["modules"] == 128  # a box of 4 by 2 by 2 blocks
    assert found["method"] == "blocks"
    assert found["has_path"]
    assert is_path(found["cells"])
    assert len(found["cells"]) == 128
    assert found["iou"] == pytest.approx(1.0, abs=0.02)
    assert found["knot"]["verdict"] == "unknot"
    assert found["expected_as_published_s"] > found["expected_s"] > 0
    # The mesh lies where the cells are: both fill the same box.
    cells, vertices = np.array(found["cells"]), np.array(found["mesh"]["vertices"])
    np.testing.assert_allclose(vertices.min(axis=0), cells.min(axis=0) - 0.5, atol=0.2)
    np.testing.assert_allclose(vertices.max(axis=0), cells.max(axis=0) + 0.5, atol=0.2)


def test_an_earlier_preview_is_looked_at_again_with_other_options(desk: Service) -> None:
    first = report(desk, stl(), modules="64")
    again = report(desk, preview=first["id"], modules="216", full="false")
    assert again["id"] == first["id"]
    assert again["key"] != first["key"]
    assert again["modules"] > first["modules"]
    assert again["cells"] == []
    assert again["mesh"] is None
    same = report(desk, preview=first["id"], modules="64")
    assert same == first


def test_cells_without_a_path_are_explained_and_repaired(desk: Service) -> None:
    found = report(desk, voxels(CROSS, name="cross"))
    assert not found["has_path"]
    assert found["feasibility"]["feasible"] is False
    assert all(problem["detail"] for problem in found["feasibility"]["problems"])
    assert found["feasibility"]["repairs"]
    repaired = report(desk, preview=found["id"], repair="true")
    assert repaired["has_path"]
    assert is_path(repaired["cells"])
    doubled = report(desk, preview=found["id"], method="blocks")
    assert doubled["modules"] == 8 * len(CROSS)
    assert is_path(doubled["cells"])


def test_a_list_of_cells_in_no_order_is_taken_as_voxels_and_that_is_said(desk: Service) -> None:
    cells = box(4, 3, 2)[::-1]
    cells[0], cells[7] = cells[7], cells[0]
    data = json.dumps(cells).encode()
    found = report(desk, data)
    assert (found["kind"], found["as_voxels"]) == ("voxels", True)
    assert found["notes"][0] == "Read as voxels, because cells 1 and 2 are not neighbours."
    assert is_path(found["cells"])
    assert {tuple(c) for c in found["cells"]} == {tuple(c) for c in cells}
    asked = report(desk, data, as_voxels="true")
    assert asked["cells"] == found["cells"]
    assert not any(note.startswith("Read as voxels") for note in asked["notes"])
    # A fold is told what to do; it does not guess.
    refused = desk.http.post("/api/folds", data={"preview": found["id"]})
    assert (refused.status_code, refused.json()["code"]) == (422, "not-adjacent")
    assert "voxels" in refused.json()["detail"]
    assert desk.fold(preview=found["id"], as_voxels="true")["id"]


def test_cells_that_come_twice_are_an_error_still(desk: Service) -> None:
    refused = ask(desk, json.dumps([*box(2, 2, 1), [0, 0, 0]]).encode())
    assert (refused.status_code, refused.json()["code"]) == (422, "repeated-cell")


def test_a_path_begins_where_it_is_asked_to(desk: Service) -> None:
    found = report(desk, stl(), modules="64")
    cell = found["cells"][17]
    start = ",".join(map(str, cell))
    begun = report(desk, preview=found["id"], modules="64", start=start)
    assert (begun["cells"][0], begun["start"], begun["not_started"]) == (cell, cell, "")
    assert is_path(begun["cells"])
    fold = desk.fold(preview=found["id"], modules="64", start=start)
    request = json.loads((desk.directory(fold["id"]) / "request.json").read_text())
    assert request["start"] == cell
    nowhere = ask(desk, preview=found["id"], modules="64", start="99,0,0")
    assert (nowhere.status_code, nowhere.json()["code"]) == (422, "not-a-cell")
    assert ask(desk, preview=found["id"], start="here").json()["code"] == "bad-start"
    odd = report(desk, voxels(box(3, 3, 3)), start="1,0,0")
    assert odd["not_started"]
    assert odd["cells"][0] != [1, 0, 0]


@pytest.mark.parametrize("module", ["cube", "tetrahedron"])
def test_what_came_of_it_is_drawn_for_browsers_without_3d(desk: Service, module: str) -> None:
    found = report(desk, voxels(box(3, 2, 2), name="<script>"), module=module)
    where = f"/previews/{found['id']}/drawing.svg"
    answer = desk.http.get(where, params={"key": found["key"]})
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("image/svg+xml")
    assert answer.headers["content-security-policy"] == "default-src 'none'"
    assert "script" not in answer.text
    drawn = ElementTree.fromstring(answer.text)
    assert len(list(drawn)) > 2
    assert len(answer.content) < 200_000
    for key in ("", "0" * 24, "../../upload", found["key"][:-1]):
        assert desk.http.get(where, params={"key": key}).status_code == 404
    elsewhere = desk.http.get("/previews/nosuch/drawing.svg", params={"key": found["key"]})
    assert elsewhere.status_code == 404


@pytest.mark.parametrize("module", ["cube", "tetrahedron"])
def test_what_came_of_it_is_shown_in_3d(desk: Service, module: str) -> None:
    found = report(desk, stl(), modules="64", module=module)
    where = f"/previews/{found['id']}/scene"
    answer = desk.http.get(f"{where}/{found['key']}")
    assert answer.status_code == 200
    assert answer.headers["cache-control"].startswith("private")
    header, arrays = decode(answer.content)
    assert header["hull"]["modules"] == found["modules"]
    assert arrays["cells"].tolist() == found["cells"]
    assert {"/solid", "/cells", "/path"} <= {m.get("name") for m in header["messages"]}
    for key in ("0" * 24, "upload.json", "..%2Fupload", found["key"][:-1], found["key"].upper()):
        assert desk.http.get(f"{where}/{key}").status_code == 404
    for preview in ("nosuch", "..", "x" * 40):
        refused = desk.http.get(f"/previews/{preview}/scene/{found['key']}")
        assert refused.status_code == 404


def test_scenes_are_made_a_few_at_once_and_each_once(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    previews = Previews(Settings(data_dir=tmp_path), store)
    scenes = PreviewScenes(previews)
    preview_id = "thing"
    (tmp_path / "upload").mkdir()
    (tmp_path / "upload" / "input").write_bytes(b"")
    row = PreviewRow(id=preview_id, visitor="a", created_at=time.time(), seen_at=time.time())
    previews.add(row, tmp_path / "upload")
    keys = [f"{k:024x}" for k in range(MAX_PENDING_SCENES + 1)]
    for key in keys[:-1]:
        place = previews.directory(preview_id) / key
        place.mkdir()
        (place / "report.json").write_text(json.dumps({"cells": [[0, 0, int(key, 16)]]}))
    go_on = threading.Event()
    made: list[Any] = []

    def draw(report: Any) -> bytes:
        made.append(report["cells"])
        assert go_on.wait(30)
        return json.dumps(report).encode()

    monkeypatch.setattr("server.files.preview_scenes.preview_scene_of", draw)

    async def ask() -> None:
        async with asyncio.TaskGroup() as group:
            asked = [
                group.create_task(scenes.scene(preview_id, k, visitor=k)) for k in keys[:-1] * 2
            ]
            while len(scenes._flight) < MAX_PENDING_SCENES:
                await asyncio.sleep(0.01)
            with pytest.raises(Unavailable) as refused:
                await scenes.scene(preview_id, keys[-1], visitor="z")
            assert len(made) <= SCENES_AT_ONCE
            assert (refused.value.retry_after_s or 0) > 0
            go_on.set()
        assert len({task.result() for task in asked}) == MAX_PENDING_SCENES
        assert await scenes.scene(preview_id, keys[0], visitor="z") == asked[0].result()
        assert len(made) == MAX_PENDING_SCENES
        with pytest.raises(NoSuchPreviewError):
            await scenes.scene(preview_id, keys[-1], visitor="z")  # there is no report
        shutil.rmtree(previews.directory(preview_id))
        with pytest.raises(NoSuchPreviewError):
            await scenes.scene(preview_id, keys[0], visitor="z")
        scenes.close()

    asyncio.run(ask())


def test_the_page_of_a_fold_draws_what_its_preview_has_found(desk: Service) -> None:
    found = report(desk, stl(), modules="64", seed="5")
    fold = desk.fold(preview=found["id"], modules="64", seed="5")
    page = desk.http.get(f"/folds/{fold['id']}").text
    drawn = page[page.index("<svg", page.index("cover-art")) :].partition("</svg>")[0] + "</svg>"
    assert drawn == isometric_svg(found["cells"])
    # What nobody has looked at yet is a mesh of any shape: nothing is drawn, not something else.
    other = desk.fold(preview=found["id"], modules="96", seed="5")
    page = desk.http.get(f"/folds/{other['id']}").text
    assert '<div class="cover-art"></div>' in page


def test_blocks_are_no_remedy_for_cells_apart(desk: Service) -> None:
    apart = voxels([[0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 0, 0]])
    found = report(desk, apart, method="blocks")
    assert not found["has_path"]
    assert not any("There is always a path" in note for note in found["notes"])
    refused = [
        desk.http.post("/api/folds", files={"file": ("a.json", apart)}, data={"method": method})
        for method in ("auto", "blocks")
    ]
    assert [answer.status_code for answer in refused] == [422, 422]
    for answer in refused:
        assert "2 parts" in answer.json()["detail"]
        assert "'blocks'" not in answer.json()["detail"]
    crossed = desk.http.post("/api/folds", files={"file": ("cross.json", voxels(CROSS))})
    assert "'blocks'" in crossed.json()["detail"]
    whole = report(desk, voxels(CROSS), method="blocks")
    assert any("There is always a path" in note for note in whole["notes"])


def test_a_path_stays_as_it_is_and_its_knot_is_told(desk: Service) -> None:
    found = report(desk, json.dumps(SNAKE).encode())
    assert found["kind"] == "path"
    assert found["modules"] == len(SNAKE)
    assert found["knot"]["verdict"] == "unknot"
    assert found["feasibility"] is None


@pytest.mark.parametrize(
    ("form", "code"),
    [
        ({"modules": "2"}, "bad-modules"),
        ({"modules": "100000"}, "bad-modules"),
        ({"modules": "1001"}, "too-many-modules"),
        ({"modules": "many"}, "bad-modules"),
        ({"method": "magic"}, "unknown-method"),
        ({"ends": "inside"}, "unknown-ends"),
        ({"seed": "-1"}, "bad-seed"),
        ({"shape": "mallet-64"}, "file-or-shape"),
    ],
    ids=str,
)
def test_bad_options_are_refused(desk: Service, form: dict[str, str], code: str) -> None:
    answer = ask(desk, voxels(box(2, 2, 2)), **form)
    assert answer.status_code == 422, answer.text
    assert answer.json()["code"] == code


def test_nothing_to_preview_is_refused(desk: Service) -> None:
    assert ask(desk, modules="64").json()["code"] == "file-or-shape"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(500),
        b"solid nothing\nendsolid nothing\n",
        bytes(80) + struct.pack("<I", 10_000_000) + bytes(50),
        b"VOX " + bytes(40),
        b"#binvox 1\ndim 9999999 9999999 9999999\ndata\n",
        b"glTF\x02\x00\x00\x00\xff\xff\xff\x7f",
        b"PK\x03\x04" + bytes(60),
        stl(hole=True)[:200],
        b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ],
    ids=lambda data: repr(data[:12]),
)
def test_bad_files_get_a_clear_word(desk: Service, data: bytes) -> None:
    answer = ask(desk, data)
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["code"]
    assert len(answer.json()["detail"]) > 20


@pytest.mark.parametrize("preview", ["nosuchpreview", "../../etc", "..", "x" * 300, ""])
def test_unknown_previews_are_told_so(desk: Service, preview: str) -> None:
    assert ask(desk, preview=preview).status_code in (404, 422)
    answer = desk.http.post("/api/folds", data={"preview": preview})
    assert answer.status_code in (404, 422)


def test_a_preview_beyond_its_time_is_told_so(here_with) -> None:
    service = here_with(preview_seconds=0.02).start()
    answer = ask(service, stl(), modules="2000")
    assert answer.status_code == 504
    assert answer.json()["code"] == "preview-too-slow"
    assert "fewer modules" in answer.json()["detail"]
    # The service goes on, and so do those who fold.
    assert service.fold(SNAKE)["id"]


def test_old_previews_make_room_for_new_ones(here_with) -> None:
    service = here_with(previews_bytes=2**22).start()
    cells = voxels(box(2, 2, 2), padding="x" * 700_000)
    padded = cells + b" " * 1_100_000
    ids = [report(service, padded, full="false")["id"] for _ in range(3)]
    oldest = service.settings.previews_dir / ids[0]
    end = time.monotonic() + PATIENCE_S
    while oldest.exists() and time.monotonic() < end:
        assert ask(service, preview=ids[-1]).status_code == 200
        time.sleep(0.05)
    assert ask(service, preview=ids[0]).status_code == 404


def test_a_fold_takes_a_preview_and_its_options(desk: Service) -> None:
    found = report(desk, stl(), modules="64")
    token = new_token()
    first = desk.fold(token=token, preview=found["id"], modules="64")
    request = json.loads((desk.directory(first["id"]) / "request.json").read_text())
    assert request["modules"] == 64
    assert request["filename"] == "thing.bin"
    assert desk.fold(token=token, preview=found["id"], modules="64")["id"] == first["id"]
    others = [
        {"modules": "72"},
        {"modules": "64", "method": "blocks"},
        {"modules": "64", "ends": "surface"},
        {"modules": "64", "repair": "true"},
    ]
    ids = {desk.fold(token=token, preview=found["id"], **options)["id"] for options in others}
    assert len(ids | {first["id"]}) == 1 + len(others)


def test_a_fold_of_cells_without_a_path_is_refused_at_once(desk: Service) -> None:
    answer = desk.http.post("/api/folds", files={"file": ("cross.json", voxels(CROSS))})
    assert answer.status_code == 422
    assert answer.json()["code"] == "no-path"
    assert "repair" in answer.json()["detail"]


@pytest.mark.slow
def test_a_mesh_is_folded(service: Service) -> None:
    accepted = service.http.post(
        "/api/folds", files={"file": ("brick.stl", stl())}, data={"modules": "24"}
    ).json()
    state = service.wait_over(accepted["id"])
    assert state["status"] == "verified", state
    assert state["modules"] == report(service, stl(), modules="24")["modules"]


def test_cells_alone_take_no_search(desk: Service) -> None:
    cross = report(desk, voxels(CROSS), path="false")
    assert (cross["kind"], cross["has_path"], cross["feasibility"]) == ("voxels", False, None)
    assert sorted(cross["cells"]) == sorted(CROSS)
    brick = report(desk, stl(), path="false", method="exact", modules="16")
    assert (brick["kind"], brick["modules"], brick["iou"]) == ("mesh", 16, 1.0)
    assert (brick["mesh"], brick["line"]) == (None, None)
    # With a path it is another report.
    assert report(desk, preview=brick["id"], modules="16")["has_path"]
    path = report(desk, json.dumps(SNAKE).encode(), path="false")
    assert (path["kind"], path["has_path"], path["cells"]) == ("path", True, SNAKE)


def test_pages_of_previews(desk: Service) -> None:
    found = report(desk, voxels(box(2, 2, 2), name="<script>alert(1)</script>"))
    page = desk.http.get(found["links"]["page"])
    assert page.status_code == 200
    assert "unsafe-inline" not in page.headers["content-security-policy"].split("style-src")[0]
    assert desk.http.get("/previews/nosuchpreview").status_code == 404
    assert desk.http.get("/shapes/new").status_code == 200
    drawing = desk.http.get("/shapes/mallet-64.svg")
    assert drawing.headers["content-type"] == "image/svg+xml"
    assert desk.http.get("/shapes/nothing.svg").status_code == 404


def test_the_page_of_a_fold_of_a_mesh_waits_for_its_cells(desk: Service) -> None:
    for data, name in ((stl(), "brick.stl"), (voxels(box(4, 2, 2)), "box.json")):
        accepted = desk.http.post("/api/folds", files={"file": (name, data)}).json()
        assert desk.http.get(accepted["links"]["page"]).status_code == 200


def test_a_preview_that_nobody_waits_for_is_given_up(here_with) -> None:
    service = here_with(preview_seconds=300.0).start()
    report(service, voxels(box(2, 2, 2)))
    (busy,) = service.children("preparer")
    busy.suspend()  # as one that would go on for ever
    with pytest.raises(httpx.ReadTimeout):
        service.http.post(
            "/api/shapes/preview", files={"file": ("box.json", voxels(box(4, 4, 2)))}, timeout=1.0
        )
    # The child that was busy with it is ended, and the next preview has one of its own.
    assert report(service, voxels(box(4, 2, 2)))["has_path"]
    assert not busy.is_running() or busy.status() == "zombie"
