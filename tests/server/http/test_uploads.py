"""Uploads: accepted and refused files, and the messages of refusals."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.readers.gallery import Gallery
from server.processes.read_task import check
from server.store.owner import new_token
from tests.server.service import SNAKE, Service

TOKEN = new_token()


def npy(array: object) -> bytes:
    file = io.BytesIO()
    np.save(file, np.asarray(array), allow_pickle=False)
    return file.getvalue()


def path(cells: object, **more: object) -> bytes:
    return json.dumps({"format": "foldback-path/1", "cells": cells, **more}).encode()


def straight(count: int) -> list[list[int]]:
    return [[i, 0, 0] for i in range(count)]


def chain(angles: object) -> bytes:
    return json.dumps(
        {"format": "foldback-chain/1", "module": "cube", "joint_angles_deg": angles}
    ).encode()


GOOD = straight(60)
BAD: dict[str, tuple[bytes, str, str | None]] = {
    "not adjacent": (path([*GOOD[:42], *GOOD[43:]]), "not-adjacent", "cells 41 and 42"),
    "repeated": (path([[0, 0, 0], [1, 0, 0], [0, 0, 0]]), "repeated-cell", "cells 0 and 2"),
    "one cell": (path([[0, 0, 0]]), "too-few-cells", None),
    "not whole": (path([[0, 0, 0], [1, 0, 0], [2.5, 0, 0]]), "not-whole", "cell 2"),
    "NaN": (b'{"format": "foldback-path/1", "cells": [[0,0,0],[NaN,0,0]]}', "", None),
    "NaN in npy": (npy([[0.0, 0, 0], [np.nan, 0, 0], [2, 0, 0]]), "not-finite", "cell 1"),
    "huge": (path([[10**9 + i, 0, 0] for i in range(5)]), "too-far", "cell 0"),
    "empty": (b"", "empty", None),
    "truncated": (path(GOOD)[:-200], "", None),
    "truncated npy": (npy(GOOD)[:-100], "truncated", None),
    "wrong version": (
        json.dumps({"format": "foldback-path/9", "cells": GOOD}).encode(),
        "wrong-version",
        None,
    ),
    "overlap": (chain([[90, 0], [90, 0], [90, 0], [90, 0], [0, 0]]), "overlap", ""),
    "another kind": (b"\x89PNG\r\n\x1a\n" + bytes(200), "wrong-kind", None),
    "prose": (b"Dear Sir or Madam, please fold this.", "wrong-kind", None),
    "too long": (path(straight(1500)), "too-many-modules", None),
    "pickle": (npy([1, 2, 3])[:6] + b"\x01\x00v\x00{'descr': '|O'", "", None),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_with_code_and_where(desk: Service, name: str) -> None:
    data, code, where = BAD[name]
    before = desk.metrics().text
    answer = desk.http.post("/api/folds", files={"file": ("shape.json", data)})
    problem = answer.json()
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert problem["code"] == code or (not code and problem["code"])
    assert "xpected" in problem["detail"] or ";" in problem["detail"], problem["detail"]
    if where is not None:
        assert where in (problem["where"] or ""), problem
        assert where or problem["where"]
    assert _folds(before) == _folds(desk.metrics().text)


def _folds(metrics: str) -> list[str]:
    return [line for line in metrics.splitlines() if line.startswith("foldback_folds")]


def test_too_large_an_upload_is_refused_while_it_comes_in(desk: Service) -> None:
    answer = desk.http.post("/api/folds", files={"file": ("big.json", b"[" * 400_000)})
    assert answer.status_code == 413
    assert answer.json()["code"] == "too-large"
    assert "0.191 MB, the limit" in answer.json()["detail"]


@pytest.mark.long
def test_a_mesh_of_many_triangles_written_as_text_is_taken(service: Service) -> None:
    facet = (
        "  facet normal 0.000000e+00 0.000000e+00 -1.000000e+00\n    outer loop\n"
        f"{3 * VERTEX}    endloop\n  endfacet\n"
    )
    triangles = triangles_of_a_torus(224)
    facets = facet * len(triangles) % tuple(triangles.ravel().tolist())
    data = f"solid torus\n{facets}endsolid torus".encode()
    assert len(data) > 24e6
    answer = service.http.post(
        "/api/shapes/preview", files={"file": ("torus.stl", data)}, data={"full": "false"}
    )
    assert answer.status_code == 200, answer.text
    assert answer.json()["has_path"]


VERTEX = "      vertex %.6e %.6e %.6e\n"


def triangles_of_a_torus(steps: int) -> NDArray[np.float64]:
    """2 · steps² triangles."""
    around = np.linspace(0.0, 2 * np.pi, steps + 1)
    u, v = np.meshgrid(around, around, indexing="ij")
    reach = 30 + 10 * np.cos(v)
    points = np.stack([reach * np.cos(u), reach * np.sin(u), 10 * np.sin(v)], axis=-1)
    points[-1], points[:, -1] = points[0], points[:, 0]
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    both = np.concatenate([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)])
    return both.reshape(-1, 3, 3)


def test_an_upload_without_a_length_is_counted(desk: Service) -> None:
    def endless():
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
        for _ in range(100):
            yield b"1,2,3\n" * 1000

    answer = desk.http.post(
        "/api/folds",
        content=endless(),
        headers={"Content-Type": "multipart/form-data; boundary=x"},
    )
    assert answer.status_code == 413


def test_a_body_that_is_no_form_is_a_problem(desk: Service) -> None:
    answer = desk.http.post(
        "/api/folds", content=b"???", headers={"Content-Type": "multipart/form-data; boundary=x"}
    )
    assert answer.status_code in (400, 422)
    assert answer.json()["code"]


@pytest.mark.parametrize(
    ("form", "code"),
    [
        ({}, "file-or-shape"),
        ({"shape": "no such shape"}, "no-such-shape"),
        ({"shape": "mallet-64", "repair": "perhaps"}, "bad-request"),
    ],
)
def test_bad_parameters_are_refused(desk: Service, form: dict[str, str], code: str) -> None:
    answer = desk.http.post("/api/folds", data=form)
    assert answer.status_code == 422, answer.text
    assert answer.json()["code"] == code


def test_the_gallery_can_be_listed_and_every_shape_is_accepted(
    desk: Service, tmp_path: Path
) -> None:
    shapes = desk.http.get("/api/shapes").json()["shapes"]
    counts = [shape["modules"] for shape in shapes]
    assert {24, 64, 80, 94, 160, 192} <= set(counts)
    assert counts == sorted(counts)
    gallery = {shape.name: shape for shape in Gallery().shapes()}
    assert gallery.keys() == {shape["name"] for shape in shapes}
    for shape in shapes:
        kept = gallery[shape["name"]]
        (tmp_path / "input").write_bytes(kept.data)
        (tmp_path / "request.json").write_text(json.dumps({"filename": kept.filename}))
        found = check(tmp_path)
        assert (found["modules"], found["module"]) == (shape["modules"], shape["module"])
    (ring,) = (shape for shape in shapes if shape["name"] == "tetra-ring")
    for shape in (ring, shapes[0], shapes[-1]):
        state = desk.state(desk.fold(shape=shape["name"])["id"])
        assert state["modules"] == shape["modules"]
        assert state["shape"] == shape["name"]


def test_the_same_upload_of_the_same_visitor_is_the_same_fold(desk: Service) -> None:
    token = new_token()
    first, again = (desk.fold(SNAKE, seed="5", token=token) for _ in range(2))
    assert (first["existing"], again["existing"]) == (False, True)
    assert again["id"] == first["id"]
    assert again["owner_token"] == first["owner_token"] == token


@pytest.mark.parametrize(
    "form", [{"seed": "6"}, {"preset": "paper"}, {"module_size": "0.9"}], ids=str
)
def test_other_parameters_are_another_fold(desk: Service, form: dict[str, str]) -> None:
    ids = [desk.fold(SNAKE, token=TOKEN, **options)["id"] for options in (form, {"seed": "5"})]
    assert ids[0] != ids[1]


def test_names_of_files_are_harmless(desk: Service) -> None:
    name = '../../etc/<script>"\n.json'
    cells = [[0, i, 7] for i in range(5)]
    answer = desk.http.post("/api/folds", files={"file": (name, json.dumps(cells))})
    assert answer.status_code == 202, answer.text
    fold_id = answer.json()["id"]
    shown = desk.state(fold_id)["name"]
    assert "/" not in shown and "\n" not in shown
    request = json.loads((desk.directory(fold_id) / "request.json").read_text())
    assert "/" not in request["filename"]
    assert desk.http.get(f"/folds/{fold_id}").text.count("<script>") == 1  # that of the theme


def test_a_full_queue_says_when_to_try_again(here_with) -> None:
    service = here_with(largest_queue_of_visitor=2).start()
    service.fold(SNAKE, seed="0")
    service.fold(SNAKE, seed="1", token=TOKEN)
    answer = service.http.post("/api/folds", data={"shape": "mallet-64"})
    assert answer.status_code == 429
    assert int(answer.headers["retry-after"]) > 0
    assert answer.json()["code"] == "queue-full"
    # What is there already costs nothing, and is given even now.
    assert service.fold(SNAKE, seed="1", token=TOKEN)["existing"]


def test_a_visitor_has_few_seconds_of_work_waiting_and_others_go_on(here_with) -> None:
    service = here_with(largest_queue_seconds_of_visitor=30, trusted_proxies="127.0.0.0/8").start()
    dear = {"shape": "mallet-64", "preset": "paper"}
    service.fold(**dear, seed="0")
    answer = service.http.post("/api/folds", data={**dear, "seed": "1"})
    assert (answer.status_code, answer.json()["code"]) == (429, "queue-full")
    assert "30 s" in answer.json()["detail"]
    other = {"X-Forwarded-For": "203.0.113.9"}
    answer = service.http.post("/api/folds", data={**dear, "seed": "1"}, headers=other)
    assert answer.status_code == 202
    state = service.state(service.fold(SNAKE, seed="2")["id"])
    assert state["progress"]["queue_position"] == 1, "quick folds have places of their own"


def test_no_upload_is_taken_when_the_disk_is_nearly_full(here_with) -> None:
    service = here_with(min_free_disk_bytes=2**60).start()
    answer = service.http.post("/api/folds", data={"shape": "mallet-64"})
    assert answer.status_code == 507
    assert answer.json()["code"] == "no-room"
    assert service.http.get("/ready").status_code == 503
    assert service.http.get("/health").status_code == 200


def test_a_waiting_fold_knows_its_place_and_its_chain(here_with) -> None:
    service = here_with().start()
    first, second = service.fold(SNAKE, seed="0"), service.fold(SNAKE, seed="1")
    states = [service.state(fold["id"]) for fold in (first, second)]
    assert [state["progress"]["queue_position"] for state in states] == [1, 2]
    assert [state["modules"] for state in states] == [16, 16]
    assert [state["status"] for state in states] == ["queued", "queued"]
