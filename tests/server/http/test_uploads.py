"""Uploads: accepted and refused files, and the messages of refusals."""

from collections.abc import Iterator

from foldback.planner.readers.gallery import Gallery
from foldback.server.store.owner import new_token
from tests.case import case
from tests.server.service_process import SNAKE, Service, check_problem, path_file
from tests.server.service_thread import ServiceWith

TOKEN = new_token()


GOOD = [[i, 0, 0] for i in range(60)]
BAD: dict[str, tuple[bytes, str, str | None]] = {
    "not adjacent": (path_file([*GOOD[:42], *GOOD[43:]]), "not-adjacent", "cells 41 and 42"),
    "empty": (b"", "empty", None),
    "truncated": (path_file(GOOD)[:-200], "", None),
    "another kind": (b"%PDF-1.7\n" + bytes(200), "wrong-kind", None),
    "damaged picture": (b"\x89PNG\r\n\x1a\n" + bytes(200), "damaged", None),
    "too long": (path_file([[i, 0, 0] for i in range(1500)]), "too-many-modules", None),
    "pickle": (b"\x93NUMPY\x01\x00v\x00{'descr': '|O'", "", None),
}
"""Invalid inputs with code and position; tests/planner/shapes has more of them."""


def test_bad_input_is_refused_with_code_and_where(idle: Service) -> None:
    before = len(list(idle.directory(".").iterdir()))
    for name, (data, code, error_place) in BAD.items():
        with case(name):
            answer = idle.http.post("/api/folds", files={"file": ("shape.json", data)})
            problem = answer.json()
            detail = check_problem(answer, 422, code or problem["code"])
            assert problem["code"] and ("xpected" in detail or ";" in detail), detail
            assert error_place in (None, problem["where"])
    assert len(list(idle.directory(".").iterdir())) == before


def test_codes_of_snakes_and_snake_cubes_are_accepted(idle: Service) -> None:
    for text, name, module, modules in (
        ("11331311313311331311313", "Ball", "snake-prism", 24),
        ("cube: 001010101111010111011011100", "Cubra Blue", "snake-cube", 27),
    ):
        with case(text):
            files = {"file": ("figure.txt", text.encode())}
            state = idle.state(idle.http.post("/api/folds", files=files).json()["id"])
            assert (state["name"], state["module"], state["modules"]) == (name, module, modules)
            report = idle.preview("figure.txt", text.encode())
            assert (report["kind"], report["module"]) == ("chain", module)
            assert len(report["positions"]) == modules
    for text, code in (
        ("LRLLR", "ambiguous-code"),
        ("2222222", "overlap"),
        ("1L1 2R2", "bad-code"),
    ):
        with case(text):
            answer = idle.http.post("/api/folds", files={"file": ("a.txt", text.encode())})
            check_problem(answer, 422, code)


def test_too_large_upload_is_refused_while_it_comes_in(idle: Service) -> None:
    answer = idle.http.post("/api/folds", files={"file": ("big.json", b"[" * 400_000)})
    assert "the limit of 0.191 MB" in check_problem(answer, 413, "too-large")


def test_upload_without_a_length_is_counted(idle: Service) -> None:
    def endless() -> Iterator[bytes]:
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
        for _ in range(100):
            yield b"1,2,3\n" * 1000

    kind = {"Content-Type": "multipart/form-data; boundary=x"}
    assert idle.http.post("/api/folds", content=endless(), headers=kind).status_code == 413
    answer = idle.http.post("/api/folds", content=b"???", headers=kind)
    assert (answer.status_code in (400, 422), bool(answer.json()["code"])) == (True, True)


def test_every_shape_of_the_gallery_is_listed_and_accepted(idle: Service) -> None:
    shapes = idle.http.get("/api/shapes").json()["shapes"]
    counts = [shape["modules"] for shape in shapes]
    assert counts == sorted(counts)
    assert {shape.name for shape in Gallery().shapes()} == {shape["name"] for shape in shapes}
    (ring,) = (shape for shape in shapes if shape["name"] == "tetra-ring")
    for shape in (ring, shapes[0], shapes[-1]):
        state = idle.state(idle.fold(shape=shape["name"])["id"])
        assert (state["modules"], state["shape"]) == (shape["modules"], shape["name"])
        assert state["name"] == shape["title"]


def test_full_queue_is_refused_with_retry_after(service_with: ServiceWith) -> None:
    service = service_with(largest_queue_of_visitor=2).start()
    folds = [service.fold(SNAKE, seed=seed, token=TOKEN) for seed in "01"]
    states = [service.state(fold["id"]) for fold in folds]
    assert [state["progress"]["queue_position"] for state in states] == [1, 2]
    assert [(state["modules"], state["status"]) for state in states] == [(16, "queued")] * 2
    answer = service.http.post("/api/folds", data={"shape": "mallet-64"})
    check_problem(answer, 429, "queue-full", retry=True)
    # Existing folds cost nothing, and are returned even now.
    assert service.fold(SNAKE, seed="1", token=TOKEN)["existing"]


def test_uploads_are_refused_when_the_disk_is_nearly_full(service_with: ServiceWith) -> None:
    service = service_with(min_free_disk_bytes=2**60).start()
    status, problem = service.refusal(shape="mallet-64")
    assert (status, problem["code"]) == (507, "no-room")
    assert service.http.get("/ready").status_code == 503
    assert service.http.get("/health").status_code == 200
