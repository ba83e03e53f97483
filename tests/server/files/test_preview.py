"""Previews: answers, refusals, storage, and the same options as folds."""

import json
import struct
from typing import Any, Final
from xml.etree import ElementTree

import httpx
import numpy as np
import pytest
import trimesh

from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.plan.prepared_chains import PreparedChains, key_of
from foldback.server.processes import children
from foldback.server.store.owner import new_token
from foldback.web.pictures.isometric import isometric_svg
from tests.planner.solids_made import Mesh, exported
from tests.server.service_process import SNAKE, Service, check_problem, wait_until
from tests.web.timeline.decoding import decode

CROSS = [[1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 2, 0]]


def voxels(cells: object, **extra: object) -> bytes:
    return json.dumps({"format": "foldback-voxels/1", "cells": cells, **extra}).encode()


def box(*size: int) -> list[list[int]]:
    return np.argwhere(np.ones(size)).tolist()


def stl(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> bytes:
    """Return boxes, each by its lower corner and its extents, as a binary STL; one by default."""
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    rows: list[bytes] = []
    for low, size in boxes or (((0.0, 0.0, 0.0), (2.0, 1.0, 1.0)),):
        corners = np.array(low) + np.argwhere(np.ones((2, 2, 2))) * np.array(size)
        rows += [struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


CORNER: Final = stl(((0.0, 0.0, 0.0), (3.0, 1.0, 1.0)), ((0.0, 1.0, 0.0), (1.0, 1.7, 1.0)))
"""Mesh that a fitted path resembles more than blocks of cubes do."""


def ask(service: Service, data: bytes | None = None, /, **form: Any) -> httpx.Response:
    return service.upload("thing.bin", data, "/api/shapes/preview", **form)


def report(service: Service, data: bytes | None = None, /, **form: Any) -> dict[str, Any]:
    return service.preview("thing.bin", data, **form)


def is_path(cells: list[list[int]]) -> bool:
    steps = np.abs(np.diff(np.array(cells), axis=0)).sum(axis=1)
    return bool((steps == 1).all()) and len({tuple(c) for c in cells}) == len(cells)


def test_mesh_becomes_about_as_many_modules_as_requested(idle: Service) -> None:
    computed_report = report(idle, stl(), modules="128")
    assert (computed_report["kind"], computed_report["method"]) == ("mesh", "blocks")
    assert (
        computed_report["modules"] == len(computed_report["cells"]) == 128
    )  # a box of 4 by 2 by 2 blocks
    assert computed_report["has_path"] and is_path(computed_report["cells"])
    assert (
        computed_report["iou"] == computed_report["likeness"]["iou"] == pytest.approx(1.0, abs=0.02)
    )
    assert computed_report["missing"]["faces"] == []
    assert [offer["likeness"] for offer in computed_report["reach"]] == [0.6, 0.75, 0.9]
    assert computed_report["knot"]["verdict"] == "unknot"
    assert computed_report["expected_as_published_s"] > computed_report["expected_s"] > 0
    # The mesh and the cells fill the same box.
    cells, vertices = (
        np.array(computed_report["cells"]),
        np.array(computed_report["mesh"]["vertices"]),
    )
    np.testing.assert_allclose(vertices.min(axis=0), cells.min(axis=0) - 0.5, atol=0.2)
    np.testing.assert_allclose(vertices.max(axis=0), cells.max(axis=0) + 0.5, atol=0.2)
    # The stored preview is requested with other options.
    second_report = report(idle, preview=computed_report["id"], modules="216", full="false")
    assert (
        second_report["id"] == computed_report["id"]
        and second_report["key"] != computed_report["key"]
    )
    assert second_report["modules"] > computed_report["modules"]
    assert (second_report["cells"], second_report["mesh"]) == ([], None)
    assert report(idle, preview=computed_report["id"], modules="128") == computed_report


def test_word_and_drawing_are_previewed_with_their_options(idle: Service) -> None:
    word = idle.preview("word.txt", "word: Анна", thickness="2")
    assert (word["kind"], word["name"], word["has_path"]) == ("word", "АННА", True)
    assert np.ptp(word["cells"], axis=0)[1] == 3
    drawing = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 6 6">'
        '<path d="M1 1h4v4h-4zM2 2v2h2v-2z"/></svg>'
    )
    ring = idle.preview("ring.svg", drawing, modules="96")
    assert (ring["kind"], ring["modules"], ring["has_path"]) == ("picture", 96, True)
    assert ring["iou"] > 0.98
    ground = idle.preview(preview=ring["id"], modules="96", inside_out="true")
    assert (ground["kind"], ground["name"]) == ("picture", "ring")
    assert ground["cells"] != ring["cells"]


@pytest.mark.long
def test_path_starts_at_the_requested_cell_and_is_folded_so(idle: Service) -> None:
    computed_report = report(idle, stl(), modules="32")
    cell = computed_report["cells"][17]
    start = ",".join(map(str, cell))
    started = report(idle, preview=computed_report["id"], modules="32", start=start)
    assert (started["cells"][0], started["start"], started["not_started"]) == (cell, cell, "")
    assert is_path(started["cells"])
    form = {"token": new_token(), "preview": computed_report["id"]}
    fold = idle.fold(**form, modules="32", start=start)
    request = json.loads((idle.directory(fold["id"]) / "request.json").read_text())
    assert (request["start"], request["modules"]) == (cell, 32)
    assert request["filename"] == "thing.bin"
    assert idle.fold(**form, modules="32", start=start)["id"] == fold["id"]
    for changed_form in ({"modules": "40"}, {"modules": "32", "ends": "surface"}):
        assert idle.fold(**form, **changed_form)["id"] != fold["id"]
    check_problem(
        ask(idle, preview=computed_report["id"], modules="32", start="99,0,0"), 422, "not-a-cell"
    )
    assert ask(idle, preview=computed_report["id"], start="here").json()["code"] == "bad-start"


def test_preview_is_drawn_and_shown_in_3d(idle: Service) -> None:
    computed_report = report(idle, voxels(box(3, 2, 2), name="<script>"))
    preview_path, key = f"/previews/{computed_report['id']}", computed_report["key"]
    answer = idle.http.get(f"{preview_path}/drawing.svg", params={"key": key})
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("image/svg+xml")
    assert answer.headers["content-security-policy"] == "default-src 'none'"
    assert "script" not in answer.text and len(answer.content) < 200_000
    assert len(list(ElementTree.fromstring(answer.text))) > 2
    answer = idle.http.get(f"{preview_path}/scene/{key}")
    assert answer.status_code == 200
    assert answer.headers["cache-control"].startswith("private")
    header, arrays = decode(answer.content)
    assert header["hull"]["modules"] == computed_report["modules"]
    assert arrays["cells"].tolist() == computed_report["cells"]
    assert {"/cells", "/path"} <= {m.get("name") for m in header["messages"]}
    for wrong in ("0" * 24, "upload.json", "..%2Fupload", key[:-1], key.upper()):
        assert idle.http.get(f"{preview_path}/scene/{wrong}").status_code == 404
        assert idle.http.get(f"{preview_path}/drawing.svg?key={wrong}").status_code == 404


def test_page_of_a_fold_draws_the_cells_of_its_preview(idle: Service) -> None:
    computed_report = report(idle, stl(), modules="64", seed="5")
    fold = idle.fold(preview=computed_report["id"], modules="64", seed="5")
    page = idle.http.get(f"/folds/{fold['id']}").text
    drawn = page[page.index("<svg", page.index("cover-art")) :].partition("</svg>")[0] + "</svg>"
    assert drawn == isometric_svg(computed_report["cells"])
    # Without a preview the shape of a mesh is unknown, and nothing is drawn.
    other_fold = idle.fold(preview=computed_report["id"], modules="96", seed="5")
    page = idle.http.get(f"/folds/{other_fold['id']}").text
    assert '<div class="cover-art"></div>' in page


def test_options_of_a_fold_are_changed_by_its_owner_only(idle: Service) -> None:
    options = {"modules": "64", "seed": "6", "ends": "surface", "prefer": "time"}
    token = new_token()
    fold = idle.upload("thing.bin", stl(), token=token, **options).json()
    page = idle.http.get(f"/folds/{fold['id']}/options")
    facts = json.loads(page.text.partition('id="facts">')[2].partition("</script>")[0])
    assert (page.status_code, facts["id"], facts["origin"]) == (200, "", {"fold": fold["id"]})
    assert facts["options"] == options
    second_report = report(idle, fold=fold["id"], modules="128", full="false", token=token)
    assert (second_report["name"], second_report["modules"]) == ("thing", 128)
    assert idle.http.get(second_report["links"]["page"]).status_code == 200
    for stranger in (None, new_token()):
        answer = ask(idle, fold=fold["id"], token=stranger)
        assert check_problem(answer, 403, "not-owner").startswith("Only the owner")
    gallery = idle.fold(shape="mallet-24")
    assert report(idle, fold=gallery["id"], full="false")["modules"] == 24
    assert idle.http.get("/folds/nosuchfold/options").status_code == 404
    check_problem(ask(idle, fold="nosuchfold"), 404, "no-such-fold")
    (idle.directory(fold["id"]) / "request.json").write_text("{}")
    page = idle.http.get(f"/folds/{fold['id']}/options")
    assert (page.status_code, "has expired" in page.text) == (404, True)


def test_blocks_are_not_offered_for_cells_apart(idle: Service) -> None:
    apart = voxels([[0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 0, 0]])
    computed_report = report(idle, apart, method="blocks")
    assert not computed_report["has_path"]
    assert not any("always has a path" in note for note in computed_report["notes"])
    for method in ("auto", "blocks"):
        answer = idle.upload("a.json", apart, method=method)
        assert answer.status_code == 422
        assert "2 parts" in answer.json()["detail"]
        assert "'blocks'" not in answer.json()["detail"]
    whole_report = report(idle, voxels(CROSS), method="blocks")
    assert (whole_report["modules"], is_path(whole_report["cells"])) == (8 * len(CROSS), True)
    assert any("always has a path" in note for note in whole_report["notes"])


def test_bad_options_and_files_are_refused(idle: Service) -> None:
    for form, code in (
        ({"modules": "2"}, "bad-modules"),
        ({"modules": "1001"}, "too-many-modules"),
        ({"shape": "mallet-64"}, "file-or-shape"),
    ):
        check_problem(ask(idle, voxels(box(2, 2, 2)), **form), 422, code)
    assert ask(idle, modules="64").json()["code"] == "file-or-shape"
    answer = ask(idle, b"solid nothing\nendsolid nothing\n")  # as for uploads to fold
    check_problem(answer, 422, answer.json()["code"])
    for preview in ("nosuchpreview", "../../etc", "..", "x" * 300, ""):
        assert ask(idle, preview=preview).status_code in (404, 422)
        assert idle.refusal(preview=preview)[0] in (404, 422)


def test_preview_beyond_its_time_is_refused(service_with, monkeypatch: pytest.MonkeyPatch) -> None:
    # The search for a path that rests on the table takes a hundred times as long. It gets the time
    # to use its limit of processor time even on a busy machine.
    monkeypatch.setattr(children, "BUSY_FACTOR", 100.0)
    service = service_with(preview_seconds=0.25).start()
    answer = ask(service, stl(), modules="2000", world="table")
    assert "fewer modules" in check_problem(answer, 504, "preview-too-slow")
    assert service.fold(SNAKE)["id"]  # the service continues


def test_preview_of_a_large_mesh_beyond_its_time_says_what_helps(
    service_with, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "BUSY_FACTOR", 100.0)
    service = service_with(preview_seconds=0.25).start()
    large = trimesh.creation.icosphere(subdivisions=7)
    assert isinstance(large, Mesh)
    refusal = check_problem(ask(service, exported("stl", large)), 504, "preview-too-slow")
    assert "simplify the m" in refusal
    assert "fewer modules" not in refusal


def test_old_previews_make_room_for_new_ones(service_with) -> None:
    service = service_with(previews_bytes=2**22).start()
    padded = voxels(box(2, 2, 2), padding="x" * 700_000) + b" " * 1_100_000
    ids = [report(service, padded, full="false")["id"] for _ in range(3)]
    oldest = service.settings.previews_dir / ids[0]
    wait_until(lambda: ask(service, preview=ids[-1]).is_success and not oldest.exists())
    assert ask(service, preview=ids[0]).status_code == 404


def test_cells_are_previewed_without_a_search(idle: Service) -> None:
    cross = report(idle, voxels(CROSS), path="false")
    assert (cross["kind"], cross["has_path"], cross["feasibility"]) == ("voxels", False, None)
    assert sorted(cross["cells"]) == sorted(CROSS)
    brick = report(idle, stl(), path="false", method="exact", modules="16")
    assert (brick["kind"], brick["modules"], brick["iou"]) == ("mesh", 16, 1.0)
    assert (brick["mesh"], brick["line"]) == (None, None)
    # The report with a path is a different one.
    assert report(idle, preview=brick["id"], modules="16")["has_path"]
    path = report(idle, json.dumps(SNAKE).encode(), path="false")
    assert (path["kind"], path["has_path"], path["cells"]) == ("path", True, SNAKE)
    path = report(idle, preview=path["id"])
    assert (path["knot"]["verdict"], path["feasibility"]) == ("unknot", None)


def test_quick_preview_of_a_mesh_is_followed_by_the_final_one_that_is_folded(idle: Service) -> None:
    first = report(idle, CORNER, modules="40", quick="true")
    assert not first["final"] and is_path(first["cells"]) and first["likeness"]
    form = {"preview": first["id"], "modules": "40"}
    final = report(idle, **form)
    assert final["final"] and final["key"] != first["key"]
    assert final["iou"] >= first["iou"]
    for preview in (first, final):
        scene = idle.http.get(f"/previews/{first['id']}/scene/{preview['key']}").content
        assert decode(scene)[1]["cells"].tolist() == preview["cells"]
    # Once there is a final result, there is no reason to answer with the first one.
    assert report(idle, **form, quick="true") == final
    cells = report(idle, voxels(box(3, 2, 2)), quick="true")
    assert cells["final"]
    assert report(idle, preview=cells["id"]) == cells  # and not searched again
    fold = idle.fold(**form, token=new_token())
    key = key_of(CORNER, "thing.bin", PathOptions(modules=40), 0)
    prepared = PreparedChains.load(idle.directory(fold["id"]), key)
    assert prepared is not None
    positions = prepared.chains[0].folded_poses.positions
    np.testing.assert_allclose(positions, final["positions"], atol=1e-9)
