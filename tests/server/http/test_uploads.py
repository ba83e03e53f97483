"""Uploads: accepted and refused files, and the messages of refusals."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest
import trimesh

from planner.readers.gallery import Gallery
from server.processes.read_task import check
from server.store.owner import new_token
from tests.server.service import SNAKE, Service

TOKEN = new_token()


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
    "NaN": (b'{"format": "foldback-path/1", "cells": [[0,0,0],[NaN,0,0]]}', "", None),
    "empty": (b"", "empty", None),
    "truncated": (path(GOOD)[:-200], "", None),
    "overlap": (chain([[90, 0], [90, 0], [90, 0], [90, 0], [0, 0]]), "overlap", ""),
    "another kind": (b"\x89PNG\r\n\x1a\n" + bytes(200), "wrong-kind", None),
    "too long": (path(straight(1500)), "too-many-modules", None),
    "pickle": (b"\x93NUMPY\x01\x00v\x00{'descr': '|O'", "", None),
}
"""Further ones are tested with the readers, in tests/planner/shapes."""


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_with_code_and_where(desk: Service, name: str) -> None:
    data, code, where = BAD[name]
    before = len(list(desk.directory(".").iterdir()))
    answer = desk.http.post("/api/folds", files={"file": ("shape.json", data)})
    problem = answer.json()
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert problem["code"] == code or (not code and problem["code"])
    assert "xpected" in problem["detail"] or ";" in problem["detail"], problem["detail"]
    if where is not None:
        assert where in (problem["where"] or ""), problem
        assert where or problem["where"]
    assert len(list(desk.directory(".").iterdir())) == before


def test_too_large_upload_is_refused_while_it_comes_in(desk: Service) -> None:
    answer = desk.http.post("/api/folds", files={"file": ("big.json", b"[" * 400_000)})
    assert (answer.status_code, answer.json()["code"]) == (413, "too-large")
    assert "0.191 MB, the limit" in answer.json()["detail"]


@pytest.mark.long
def test_text_mesh_of_many_triangles_is_accepted(service: Service) -> None:
    mesh = trimesh.creation.torus(major_radius=30, minor_radius=10, major_sections=320)
    mesh = mesh.subdivide()
    data = cast("str", mesh.export(file_type="stl_ascii")).encode()
    assert len(data) > 10e6
    answer = service.http.post(
        "/api/shapes/preview", files={"file": ("torus.stl", data)}, data={"full": "false"}
    )
    assert answer.status_code == 200, answer.text
    assert answer.json()["has_path"]


def test_upload_without_a_length_is_counted(desk: Service) -> None:
    def endless() -> Iterator[bytes]:
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
        for _ in range(100):
            yield b"1,2,3\n" * 1000

    kind = {"Content-Type": "multipart/form-data; boundary=x"}
    assert desk.http.post("/api/folds", content=endless(), headers=kind).status_code == 413
    answer = desk.http.post("/api/folds", content=b"???", headers=kind)
    assert (answer.status_code in (400, 422), bool(answer.json()["code"])) == (True, True)


def test_every_shape_of_the_gallery_is_listed_and_accepted(desk: Service, tmp_path: Path) -> None:
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


def test_same_upload_of_the_same_visitor_is_the_same_fold(desk: Service) -> None:
    token = new_token()
    first, again = (desk.fold(SNAKE, seed="5", token=token) for _ in range(2))
    assert (first["existing"], again["existing"]) == (False, True)
    assert again["id"] == first["id"]
    assert again["owner_token"] == first["owner_token"] == token
    for form in ({"seed": "6"}, {"preset": "paper"}, {"module_size": "0.9"}):
        assert desk.fold(SNAKE, token=token, **form)["id"] != first["id"], form


def test_full_queue_is_refused_with_retry_after(here_with) -> None:
    service = here_with(largest_queue_of_visitor=2).start()
    folds = [service.fold(SNAKE, seed=seed, token=TOKEN) for seed in "01"]
    states = [service.state(fold["id"]) for fold in folds]
    assert [state["progress"]["queue_position"] for state in states] == [1, 2]
    assert [(state["modules"], state["status"]) for state in states] == [(16, "queued")] * 2
    answer = service.http.post("/api/folds", data={"shape": "mallet-64"})
    assert (answer.status_code, answer.json()["code"]) == (429, "queue-full")
    assert int(answer.headers["retry-after"]) > 0
    # What is there already costs nothing, and is given even now.
    assert service.fold(SNAKE, seed="1", token=TOKEN)["existing"]


def test_queued_seconds_of_a_visitor_are_limited(here_with) -> None:
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


def test_uploads_are_refused_when_the_disk_is_nearly_full(here_with) -> None:
    service = here_with(min_free_disk_bytes=2**60).start()
    answer = service.http.post("/api/folds", data={"shape": "mallet-64"})
    assert (answer.status_code, answer.json()["code"]) == (507, "no-room")
    assert service.http.get("/ready").status_code == 503
    assert service.http.get("/health").status_code == 200
