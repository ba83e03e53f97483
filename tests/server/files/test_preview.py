"""Previews: what is answered, what is refused and kept, and that folds take the same options."""

from __future__ import annotations

import asyncio
import json
import shutil
import struct
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import httpx
import numpy as np
import pytest

from server.files.preview_scenes import PreviewScenes
from server.settings import Settings
from server.store.folds import Store
from server.store.owner import new_token
from server.store.previews import NoSuchPreviewError, Previews
from server.store.tables import PreviewRow
from tests.case import case
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


def test_mesh_becomes_about_as_many_modules_as_requested(desk: Service) -> None:
    found = report(desk, stl(), modules="128")
    assert (found["kind"], found["method"]) == ("mesh", "blocks")
    assert found["modules"] == len(found["cells"]) == 128  # a box of 4 by 2 by 2 blocks
    assert found["has_path"] and is_path(found["cells"])
    assert found["iou"] == pytest.approx(1.0, abs=0.02)
    assert found["knot"]["verdict"] == "unknot"
    assert found["expected_as_published_s"] > found["expected_s"] > 0
    # The mesh lies where the cells are: both fill the same box.
    cells, vertices = np.array(found["cells"]), np.array(found["mesh"]["vertices"])
    np.testing.assert_allclose(vertices.min(axis=0), cells.min(axis=0) - 0.5, atol=0.2)
    np.testing.assert_allclose(vertices.max(axis=0), cells.max(axis=0) + 0.5, atol=0.2)
    # It is looked at again with other options.
    again = report(desk, preview=found["id"], modules="216", full="false")
    assert again["id"] == found["id"] and again["key"] != found["key"]
    assert again["modules"] > found["modules"]
    assert (again["cells"], again["mesh"]) == ([], None)
    assert report(desk, preview=found["id"], modules="128") == found


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


def test_unordered_cells_are_previewed_as_voxels(desk: Service) -> None:
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
    status, problem = desk.refused(preview=found["id"])
    assert (status, problem["code"]) == (422, "not-adjacent")
    assert "voxels" in problem["detail"]
    assert desk.fold(preview=found["id"], as_voxels="true")["id"]
    refused = ask(desk, json.dumps([*box(2, 2, 1), [0, 0, 0]]).encode())
    assert (refused.status_code, refused.json()["code"]) == (422, "repeated-cell")


def test_path_starts_at_the_requested_cell(desk: Service) -> None:
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
def test_preview_is_drawn_and_shown_in_3d(desk: Service, module: str) -> None:
    found = report(desk, voxels(box(3, 2, 2), name="<script>"), module=module)
    where, key = f"/previews/{found['id']}", found["key"]
    answer = desk.http.get(f"{where}/drawing.svg", params={"key": key})
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("image/svg+xml")
    assert answer.headers["content-security-policy"] == "default-src 'none'"
    assert "script" not in answer.text and len(answer.content) < 200_000
    assert len(list(ElementTree.fromstring(answer.text))) > 2
    answer = desk.http.get(f"{where}/scene/{key}")
    assert answer.status_code == 200
    assert answer.headers["cache-control"].startswith("private")
    header, arrays = decode(answer.content)
    assert header["hull"]["modules"] == found["modules"]
    assert arrays["cells"].tolist() == found["cells"]
    assert {"/cells", "/path"} <= {m.get("name") for m in header["messages"]}
    for wrong in ("0" * 24, "upload.json", "..%2Fupload", key[:-1], key.upper()):
        assert desk.http.get(f"{where}/scene/{wrong}").status_code == 404
        assert desk.http.get(f"{where}/drawing.svg?key={wrong}").status_code == 404
    for preview in ("nosuch", "..", "x" * 40):
        assert desk.http.get(f"/previews/{preview}/scene/{key}").status_code == 404
        assert desk.http.get(f"/previews/{preview}/drawing.svg?key={key}").status_code == 404


def test_scenes_are_cached_and_need_a_report(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Limits of what is made at once: see tests/server/limits."""
    previews = Previews(Settings(data_dir=tmp_path), store)
    scenes = PreviewScenes(previews)
    (tmp_path / "upload").mkdir()
    (tmp_path / "upload" / "input").write_bytes(b"")
    row = PreviewRow(id="thing", visitor="a", created_at=time.time(), seen_at=time.time())
    previews.add(row, tmp_path / "upload")
    key, other = ("0" * 23 + end for end in "12")
    place = previews.directory("thing") / key
    place.mkdir()
    (place / "report.json").write_text(json.dumps({"cells": []}))
    made: list[object] = []

    def draw(report: object) -> bytes:
        made.append(report)
        return b"a scene"

    monkeypatch.setattr("server.files.preview_scenes.preview_scene_of", draw)

    def scene(key: str) -> bytes:
        return asyncio.run(scenes.scene("thing", key, visitor="a"))

    assert scene(key) == scene(key) == b"a scene" and len(made) == 1
    with pytest.raises(NoSuchPreviewError):
        scene(other)  # there is no report
    shutil.rmtree(previews.directory("thing"))
    with pytest.raises(NoSuchPreviewError):
        scene(key)
    scenes.close()


def test_page_of_a_fold_draws_the_cells_of_its_preview(desk: Service) -> None:
    found = report(desk, stl(), modules="64", seed="5")
    fold = desk.fold(preview=found["id"], modules="64", seed="5")
    page = desk.http.get(f"/folds/{fold['id']}").text
    drawn = page[page.index("<svg", page.index("cover-art")) :].partition("</svg>")[0] + "</svg>"
    assert drawn == isometric_svg(found["cells"])
    # What nobody has looked at yet is a mesh of any shape: nothing is drawn, not something else.
    other = desk.fold(preview=found["id"], modules="96", seed="5")
    page = desk.http.get(f"/folds/{other['id']}").text
    assert '<div class="cover-art"></div>' in page


def test_blocks_are_not_offered_for_cells_apart(desk: Service) -> None:
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


def test_path_is_previewed_unchanged_with_its_knot(desk: Service) -> None:
    found = report(desk, json.dumps(SNAKE).encode())
    assert (found["kind"], found["modules"]) == ("path", len(SNAKE))
    assert (found["knot"]["verdict"], found["feasibility"]) == ("unknot", None)


def test_bad_options_and_files_are_refused(desk: Service) -> None:
    for form, code in (
        ({"modules": "2"}, "bad-modules"),
        ({"modules": "1001"}, "too-many-modules"),
        ({"method": "magic"}, "unknown-method"),
        ({"shape": "mallet-64"}, "file-or-shape"),
    ):
        answer = ask(desk, voxels(box(2, 2, 2)), **form)
        assert (answer.status_code, answer.json()["code"]) == (422, code)
    assert ask(desk, modules="64").json()["code"] == "file-or-shape"
    for data in (
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
    ):
        with case(data[:12]):
            answer = ask(desk, data)
            assert answer.status_code == 422, answer.text
            assert answer.headers["content-type"] == "application/problem+json"
            assert answer.json()["code"] and len(answer.json()["detail"]) > 20
    for preview in ("nosuchpreview", "../../etc", "..", "x" * 300, ""):
        assert ask(desk, preview=preview).status_code in (404, 422)
        assert desk.refused(preview=preview)[0] in (404, 422)


def test_preview_beyond_its_time_is_refused(here_with) -> None:
    service = here_with(preview_seconds=0.02).start()
    answer = ask(service, stl(), modules="2000")
    assert (answer.status_code, answer.json()["code"]) == (504, "preview-too-slow")
    assert "fewer modules" in answer.json()["detail"]
    assert service.fold(SNAKE)["id"]  # the service goes on


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


def test_fold_takes_a_preview_and_its_options(desk: Service) -> None:
    found = report(desk, stl(), modules="64")
    asked = {"token": new_token(), "preview": found["id"]}
    first = desk.fold(**asked, modules="64")
    request = json.loads((desk.directory(first["id"]) / "request.json").read_text())
    assert (request["modules"], request["filename"]) == (64, "thing.bin")
    assert desk.fold(**asked, modules="64")["id"] == first["id"]
    for other in ({"modules": "72"}, {"modules": "64", "ends": "surface"}):
        assert desk.fold(**asked, **other)["id"] != first["id"]


@pytest.mark.slow
def test_mesh_is_folded(service: Service) -> None:
    accepted = service.http.post(
        "/api/folds", files={"file": ("brick.stl", stl())}, data={"modules": "24"}
    ).json()
    state = service.wait_over(accepted["id"])
    assert state["status"] == "verified", state
    assert state["modules"] == report(service, stl(), modules="24")["modules"]


def test_cells_are_previewed_without_a_search(desk: Service) -> None:
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


def test_pages_of_previews_and_of_their_folds(desk: Service) -> None:
    found = report(desk, voxels(box(2, 2, 2), name="<script>alert(1)</script>"))
    page = desk.http.get(found["links"]["page"])
    assert page.status_code == 200
    assert "unsafe-inline" not in page.headers["content-security-policy"].split("style-src")[0]
    assert desk.http.get("/previews/nosuchpreview").status_code == 404
    assert desk.http.get("/shapes/new").status_code == 200
    assert desk.http.get("/shapes/mallet-64.svg").headers["content-type"] == "image/svg+xml"
    assert desk.http.get("/shapes/nothing.svg").status_code == 404
    for data, name in ((stl(), "brick.stl"), (voxels(box(4, 2, 2)), "box.json")):
        accepted = desk.http.post("/api/folds", files={"file": (name, data)}).json()
        assert desk.http.get(accepted["links"]["page"]).status_code == 200


def test_preview_without_a_waiting_client_is_ended(here_with) -> None:
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
