"""Python client with the real service, also through a relay that causes failures."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foldback.client import Client, Problem, Progress, Retries
from foldback.client.upload import FoldOptions, MovieOptions, ShapeOptions
from tests.case import case
from tests.run_python import ROOT, run_python
from tests.server.relay import Relay, Trouble, running_relay
from tests.server.service_process import SNAKE, TIMEOUT_S, FinishedFold, Service
from tests.server.service_thread import ServiceThread

QUICK = Retries(first_s=0.01)
FOLDS = "/api/folds"


def client_of(service: Service) -> Client:
    return Client(str(service.http.base_url), retries=QUICK)


@contextmanager
def via_relay(
    service: Service, trouble: Trouble, retries: Retries = QUICK, retry_after: str = "0"
) -> Iterator[tuple[Client, Relay]]:
    """Yield a client that reaches a service through a relay which causes failures."""
    with (
        running_relay(service.http.base_url, trouble, retry_after) as relay,
        Client(relay.address, retries=retries) as client,
    ):
        yield client, relay


def test_fold_is_followed_and_downloaded(finished: FinishedFold, tmp_path: Path) -> None:
    reports: list[Progress] = []
    with client_of(finished.service) as client:
        fold = client.get(finished.id).wait(TIMEOUT_S, reports.append)
        assert fold.verified and reports[-1].status == "verified"
        assert reports[-1].frames == fold.state["progress"]["frames"] > 0
        (page,) = fold.frames(stride=7, poses=True)
        assert len(page) == len(range(0, page.total, 7))
        assert page.positions.shape == (len(page), 16, 3)
        with np.load(fold.download("plan.npz", tmp_path / "mine.npz")) as plan:
            folded = plan["joint_angles_rad"][-1]
        last = next(fold.frames(start=page.total - 1))
        np.testing.assert_allclose(last.joint_angles_rad[-1], folded, atol=1e-4)
        assert last.positions is None and isinstance(last.phase[0], np.integer)
        for name in ("plan.json", "urdf"):
            assert fold.download(name, tmp_path).stat().st_size > 100
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_proxies_of_the_environment(
    finished: FinishedFold, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("NO_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)
    monkeypatch.setenv("HTTP_PROXY", "http://user:secret@127.0.0.1:9")
    with client_of(finished.service) as client:  # on this machine: without the proxy
        assert client.get(finished.id).verified
    once = Retries(attempts=1)
    with (
        Client("http://foldback.test", retries=once) as client,
        pytest.raises(ConnectionError, match=r"through the proxy HTTP_PROXY=http://127") as refused,
    ):
        client.shapes()
    assert "secret" not in str(refused.value)
    monkeypatch.setenv("ALL_PROXY", "socks5://127.0.0.1:9")
    with pytest.raises(ConnectionError, match=r"ALL_PROXY=socks5://127\.0\.0\.1:9, expected"):
        Client("http://foldback.test")
    client_of(finished.service).close()


def test_frames_of_long_fold_come_in_pages(finished: FinishedFold) -> None:
    # A second web process on the same folds, which sends few frames per response.
    with (
        ServiceThread(finished.service.data_dir, frames_per_answer=20).start() as sparing,
        client_of(sparing) as client,
    ):
        pages = list(client.get(finished.id).frames(start=3))
        sparse = list(client.get(finished.id).frames(stride=2))
    assert len(pages) > 2 and max(map(len, pages)) <= 20
    assert [page.start for page in pages[1:]] == [page.stop for page in pages[:-1]]
    assert (pages[0].start, pages[-1].stop) == (3, pages[-1].total)
    assert sum(map(len, sparse)) == len(range(0, pages[0].total, 2))


@pytest.mark.long
def test_client_takes_each_kind_of_source(idle: Service, tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    path.write_text(json.dumps(SNAKE))
    solid = np.ones((4, 3, 2), bool)
    with client_of(idle) as client, open(path, "rb") as file:
        sources = (SNAKE, np.array(SNAKE), file, path, path.read_bytes())
        assert len({client.fold(source).id for source in sources}) == 1
        assert client.fold(path.read_bytes(), filename="another.json").existing
        assert client.fold(shape="box-4x4x4").state["shape"] == "box-4x4x4"
        assert client.fold(solid, modules=24, method="exact").state["modules"] == 24
        preview = client.preview(solid, modules=24, method="exact", start=(0, 0, 0))
        assert len(preview["cells"]) == 24 and preview["start"] == [0, 0, 0]
        second_fold = client.fold(preview=preview["id"], modules=24, method="exact")
        assert second_fold.state["modules"] == 24
        with pytest.raises(ValueError, match="1 dimensions"):
            client.fold(np.arange(3))
        with pytest.raises(TypeError, match="expected one of them"):
            client.fold(SNAKE, shape="box-4x4x4")
        with pytest.raises(TypeError, match="module_sise"):
            client.fold(SNAKE, module_sise=0.9)  # pyright: ignore[reportCallIssue]


def test_client_options_are_those_of_the_interface(idle: Service) -> None:
    described = idle.http.get("/api/openapi.json").json()

    def fields(path: str) -> set[str]:
        body = described["paths"][path]["post"]["requestBody"]["content"]
        (schema,) = (content["schema"] for content in body.values())
        if (reference := schema.get("$ref")) is not None:
            schema = described["components"]["schemas"][reference.rpartition("/")[2]]
        return set(schema["properties"])

    assert set(FoldOptions.__annotations__) | {"file", "shape"} == fields(FOLDS)
    of_the_page = {"path", "full", "quick"}
    assert set(ShapeOptions.__annotations__) | {"file", "shape"} | of_the_page == fields(
        "/api/shapes/preview"
    )
    assert set(MovieOptions.__annotations__) == fields("/api/folds/{fold_id}/movies")


@pytest.mark.long
def test_movie_is_requested_and_downloaded(finished: FinishedFold, tmp_path: Path) -> None:
    drawn: list[tuple[int, int]] = []
    small: Any = {"width": 64, "height": 64, "fps": 5, "seconds": 1.0, "timeout_s": TIMEOUT_S}
    with client_of(finished.service) as client:
        fold = client.get(finished.id)
        path = fold.movie(
            tmp_path / "fold.gif", on_progress=lambda done, of: drawn.append((done, of)), **small
        )
        assert path.read_bytes().startswith(b"GIF8")
        assert drawn and drawn[0][1] == 5
        with pytest.raises(Problem, match="bad-movie"):
            fold.movie(tmp_path / "large.mp4", width=100_000)
    assert not (tmp_path / "large.mp4").exists()


def test_problem_carries_the_response_of_the_service(idle: Service) -> None:
    with client_of(idle) as client, pytest.raises(Problem) as caught:
        client.fold(b'{"format": "foldback-path/1", "cells": [[0,0,0],[5,0,0],[6,0,0]]}')
    problem = caught.value
    assert problem.status == 422 and problem.code and problem.detail in str(problem)
    assert problem.where and problem.where in str(problem)
    with client_of(idle) as client, pytest.raises(Problem, match="bad-link"):
        client.ask("GET", "http://example.org/api/folds")


def lose_response(method: str) -> Trouble:
    """Return a failure that drops the response to the first request of a method."""
    return lambda request, _path, time: "lose" if (request, time) == (method, 1) else None


def test_request_with_a_lost_response_is_repeated(idle: Service) -> None:
    with via_relay(idle, lose_response("POST")) as (client, relay):
        fold = client.fold(SNAKE, seed=43)
        assert relay.requests.count(("POST", FOLDS)) == 2
        assert fold.existing  # the first request has arrived
        assert fold.cancel().status == "cancelled"
    with via_relay(idle, lose_response("DELETE")) as (client, relay):
        client.fold(SNAKE, seed=44).delete()
        assert [method for method, _ in relay.requests].count("DELETE") == 2
        with pytest.raises(Problem, match="no-such-fold"):
            client.get("nosuchfold").delete()


def refuse(status: int, times: int) -> Trouble:
    """Return a failure that refuses the first requests with a status."""
    return lambda _method, _path, time: status if time <= times else None


def test_request_to_busy_service_is_retried_a_few_times(idle: Service) -> None:
    for status, times, retry_after, requests in (
        (429, 3, "0", 4),
        (503, 9, "0", 5),  # the maximum number of requests
        (429, 9, "600", 1),  # the wait would be too long
        (500, 9, "0", 1),  # retries do not help
    ):
        retries = Retries(attempts=5, first_s=0.01)
        trouble = refuse(status, times)
        with case(status), via_relay(idle, trouble, retries, retry_after) as (client, relay):
            if requests > times:
                assert client.shapes()
            else:
                with pytest.raises(Problem, match=f"http-{status}"):
                    client.shapes()
            assert len(relay.requests) == requests


def test_unreachable_service_is_reported_after_all_attempts() -> None:
    refusal = pytest.raises(ConnectionError, match="3 attempts")
    with Client("http://127.0.0.1:9", retries=Retries(attempts=3, first_s=0.01)) as client, refusal:
        client.shapes()


def test_pauses_between_retries_grow_and_differ() -> None:
    retries = Retries(attempts=20, first_s=1.0, longest_s=30.0)
    waits = [retries.pause_s(attempt) or 0.0 for attempt in range(1, 20)]
    for attempt, wait in enumerate(waits):
        assert min(30.0, 2.0**attempt) / 2 <= wait <= min(30.0, 2.0**attempt)
    assert len(set(waits)) == len(waits)
    assert (retries.pause_s(1, 7.0) or 0.0) > 7.0
    assert retries.pause_s(20) is retries.pause_s(1, 600.0) is None


@pytest.mark.parametrize("trouble", [429, "cut"])
def test_fold_is_followed_without_its_events(idle: Service, trouble: int | str) -> None:
    with client_of(idle) as owner:
        fold = owner.fold(SNAKE, seed=50 + len(str(trouble)))
        with pytest.raises(TimeoutError, match="still queued after"):
            fold.wait(0.05)

        def no_events(_method: str, path: str, time: int) -> int | str | None:
            if not path.endswith("/events"):
                return None
            if time == 3:
                fold.cancel()
            return trouble

        with via_relay(idle, no_events) as (client, relay):
            assert client.get(fold.id).wait(TIMEOUT_S).status == "cancelled"
            assert [path.endswith("/events") for _, path in relay.requests].count(True) == 3


def test_download_is_complete_or_absent(finished: FinishedFold, tmp_path: Path) -> None:
    def cut_off(until: int) -> Trouble:
        return lambda method, path, time: "cut" if "plan" in path and time < until else None

    file = tmp_path / "plan.npz"
    with via_relay(finished.service, cut_off(3)) as (client, _):
        client.get(finished.id).download("plan.npz", file)
    assert file.read_bytes() == (finished.directory / "plan.npz").read_bytes()
    file.write_bytes(b"older")
    with via_relay(finished.service, cut_off(100)) as (client, _), pytest.raises(ConnectionError):
        client.get(finished.id).download("plan.npz", file)
    assert file.read_bytes() == b"older"
    assert [path.name for path in tmp_path.iterdir()] == ["plan.npz"]


WITHOUT_PACKAGES = """
import sys
for name in ("mujoco", "fastapi", "numpy", "pydantic", "scipy"):
    sys.modules[name] = None  # an import of it fails
"""


def test_code_of_the_api_page_runs_and_needs_only_httpx(service: Service, tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "api.md").read_text(), re.S)
    code = code.replace("http://127.0.0.1:8000", str(service.http.base_url).rstrip("/"))
    output = run_python("-W", "error", "-c", WITHOUT_PACKAGES + code, cwd=tmp_path)
    assert "verified" in output and "urdf" in output
    assert list(tmp_path.iterdir()) == [tmp_path / "plan.npz"]


@pytest.mark.long
def test_example_07_runs(service: Service, tmp_path: Path) -> None:
    example = ROOT / "examples" / "07_fold_by_api.py"
    arguments = ("--url", str(service.http.base_url), "--shape", "wrench-24")
    printed = run_python("-W", "error", str(example), *arguments, cwd=tmp_path)
    assert "clearance" in printed and "joints, folded" in printed
    assert len(list(tmp_path.iterdir())) == 2
