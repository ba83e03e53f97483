"""Folds on a table: asked for over HTTP, told in their JSON and on their pages."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import BytesIO
from typing import Any, cast

import httpx
import numpy as np
import pytest
import trimesh

from planner.pipeline.expected_cost import expected_cost
from planner.pipeline.request import FoldRequest
from tests.server.service import STAIRS, Service
from web.timeline.columns import decode

BOX = (2, 2, 2)
ROUTES = ("folds", "shapes/preview")
SLAB = [[x, y, 0] for x in range(3) for y in range(3) if (x, y) != (1, 0)]
"""Cells of a slab that has no path: one of its chessboard colours has two more than the other."""


def voxels(*sides: int) -> bytes:
    file = BytesIO()
    np.save(file, np.ones(sides, bool))
    return file.getvalue()


def asked(desk: Service, path: str = "/api/folds", **form: str) -> Any:
    files = {} if {"shape", "fold"} & set(form) else {"file": ("box.npy", voxels(*BOX))}
    return desk.http.post(path, files=files or None, data=form)


@pytest.mark.parametrize(
    ("form", "code", "words"),
    [
        ({"module": "tetrahedron"}, "unsuited-world", "got the module tetrahedron for a fold on"),
        ({"preset": "paper"}, "unsuited-world", "got the preset paper for a fold on a table"),
        ({"strategy": "blocks"}, "unsuited-world", "expected auto"),
        ({"prefer": "time"}, "unsuited-world", "got the preference time"),
        ({"method": "exact"}, "unsuited-world", "got the path method exact"),
        ({"ends": "surface"}, "unsuited-world", "got the choice of ends surface"),
        ({"start": "0,0,0"}, "unsuited-world", "got a start cell"),
        ({"method": "snake"}, "unsuited-world", "got the path method snake"),
        ({"settings": "table_torque=0"}, "bad-settings", "got table_torque = '0'"),
        ({"shape": "tetra-ring"}, "unsuited-world", "got the module tetrahedron"),
    ],
)
def test_what_cannot_be_had_on_a_table_is_refused(
    desk: Service, form: dict[str, str], code: str, words: str
) -> None:
    answer = asked(desk, world="table", **form)
    assert answer.status_code == 422
    assert answer.json()["code"] == code
    assert words in answer.json()["detail"]


def test_a_preview_refuses_in_the_same_words(desk: Service) -> None:
    form = {"world": "table", "method": "exact"}
    fold, preview = (asked(desk, f"/api/{path}", **form).json() for path in ROUTES)
    assert fold == preview


def test_settings_of_a_table_are_for_folds_on_one(desk: Service) -> None:
    answer = asked(desk, settings="table_torque=3")
    assert answer.status_code == 422
    assert "for a fold that floats" in answer.json()["detail"]


def test_a_path_is_told_that_it_is_none_for_a_table(desk: Service) -> None:
    answer = desk.http.post("/api/folds", files={"file": ("stairs.json", str(STAIRS).encode())})
    assert answer.status_code == 202
    over = [[0, 0, 1], [1, 0, 1], [2, 0, 1], [2, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]]
    answer = desk.http.post(
        "/api/folds",
        files={"file": ("over.json", str(over).encode())},
        data={"world": "table"},
    )
    assert answer.status_code == 422
    assert answer.json()["code"] == "not-for-a-table"
    assert len(answer.json()["detail"]) < 800


@pytest.mark.slow
def test_a_preview_shows_a_path_for_a_table_or_why_there_is_none(desk: Service) -> None:
    found = asked(desk, "/api/shapes/preview", world="table").json()
    assert found["has_path"] and found["method"] == "table"
    assert found["expected_s"] > asked(desk, "/api/shapes/preview").json()["expected_s"]
    cells = np.array(found["cells"])
    assert (np.diff(cells[:, 2]) >= 0).all()
    bridge = np.ones((5, 1, 3), bool)
    bridge[1:4, :, :2] = False
    bridge[2, :, 0] = True
    file = BytesIO()
    np.save(file, bridge)
    none = desk.http.post(
        "/api/shapes/preview",
        files={"file": ("bridge.npy", file.getvalue())},
        data={"world": "table"},
    ).json()
    (problem,) = none["feasibility"]["problems"]
    assert not none["has_path"]
    assert "2 parts that share no face" in problem["detail"]
    known = {tuple(cell) for cell in none["cells"]}
    assert {tuple(cell) for cell in problem["cells"]} <= known


@pytest.fixture(scope="module")
def resting(service: Service) -> dict[str, Any]:
    form = {"world": "table", "settings": "table_torque=9"}
    accepted = asked(service, **form).json()
    return service.wait_over(accepted["id"])


@pytest.mark.slow
def test_a_fold_on_a_table_tells_what_it_asks(service: Service, resting: dict[str, Any]) -> None:
    assert (resting["status"], resting["world"]) == ("verified", "table")
    table = resting["summary"]["certificate"]["table"]
    assert table["bound"] == 9.0
    assert 0.0 <= table["torque"] <= 9.0
    facts = service.http.get(f"/folds/{resting['id']}/facts").json()
    told = facts["table"]
    assert told["good"]
    assert told["text"].startswith("Stays on the table and needs at most ")
    assert told["text"].endswith("frictionless")
    assert told["assumptions"] == table["assumptions"]
    assert ["Torque limit", "at most 9 w·p"] in told["rows"]
    assert "Frames undone while unfolding" in [label for label, _ in told["rows"]]
    assert "These suit a pitch of" in told["servos"] and told["named"]
    (floating, other) = facts["compare"]
    assert floating["form"] == {"fold": resting["id"], "seed": 0, "settings": ""}
    assert (other["form"]["world"], other["form"]["settings"]) == ("table", "table_torque=9")
    assert not facts["refoldable"] and not facts["smoothable"]


@pytest.mark.slow
def test_its_forces_come_in_stretches(service: Service, resting: dict[str, Any]) -> None:
    under = f"/folds/{resting['id']}"
    header, curves = decode(service.http.get(f"{under}/figures").content)
    certificate = resting["summary"]["certificate"]["table"]
    assert header["table"]["words"] == "frictionless"
    assert header["table"]["bound"] == 9.0
    assert "peak_torque_nm" not in curves
    found = np.nanmax(curves["table_torque"])
    assert found == pytest.approx(certificate["torque"], abs=1e-5)
    _, last = decode(
        service.http.get(
            f"{under}/figures", params={"part": (header["frames"] - 1) // header["rows"]}
        ).content
    )
    assert last["pressed"][-1].sum() == pytest.approx(8.0, abs=1e-3)
    bundle, _ = decode(service.http.get(f"{under}/bundle").content)
    assert bundle["table"]["height"] == pytest.approx(-0.5)
    page = service.http.get(f"{under}/standalone.html").text
    assert '"forces": "' in page or '"forces":"' in page


@pytest.mark.slow
def test_floating_it_is_another_fold(service: Service, resting: dict[str, Any]) -> None:
    plain = service.http.post("/api/folds", data={"fold": resting["id"]}).json()
    state = service.wait_over(plain["id"])
    assert plain["id"] != resting["id"]
    assert state["world"] == "floating"
    assert "table" not in state["summary"]["certificate"]
    facts = service.http.get(f"/folds/{plain['id']}/facts").json()
    assert facts["table"] is None
    (rests,) = (way for way in facts["compare"] if way["text"] == "On a table")
    assert rests["form"]["world"] == "table"
    bundle, _ = decode(service.http.get(f"/folds/{plain['id']}/bundle").content)
    assert bundle["table"] is None


def test_who_wants_it_on_a_table_waits_for_it() -> None:
    floating, table = (expected_cost(64, FoldRequest(world=w)) for w in ("floating", "table"))
    assert table.expected_s > 10 * floating.expected_s


def slab_without_a_path(service: Service) -> tuple[dict[str, Any], dict[str, str]]:
    """Preview a slab that has no path for a table; return its report and the same options."""
    form = {"world": "table", "as_voxels": "true"}
    file = {"file": ("slab.json", str(SLAB).encode())}
    none = service.http.post("/api/shapes/preview", files=file, data=form).json()
    assert not none["has_path"]
    return none, {**form, "preview": none["id"]}


def test_offers_for_a_shape_without_a_path_lead_to_a_preview_with_one(desk: Service) -> None:
    none, same = slab_without_a_path(desk)
    (problem,) = none["feasibility"]["problems"]
    assert problem["detail"].startswith(
        "coloured like a chessboard, it has 5 black and 3 white cells; a chain needs equal"
    )
    offers = desk.http.post("/api/shapes/offers", data=same).json()["offers"]
    assert [offer["kind"] for offer in offers] == ["repair", "blocks"]
    change = {k: v for k, v in offers[0]["change"].items() if v is not None}
    better = desk.http.post("/api/shapes/preview", data={**same, **change}).json()
    assert better["has_path"]
    assert better["modules"] == offers[0]["modules"] == len(SLAB) + len(offers[0]["added"])
    # Cells that are to be added, and those that were, are drawn in a colour of their own.
    assert sorted(map(tuple, better["added"])) == sorted(map(tuple, offers[0]["added"]))
    scene = f"/previews/{none['id']}/scene/{none['key']}"
    plain, repair = (desk.http.get(scene + more).content for more in ("", "?repair=true"))
    assert b"/added" in repair and b"/added" not in plain
    drawing = f"/previews/{none['id']}/drawing.svg?key={none['key']}"
    plain, repair = (desk.http.get(drawing + more).text for more in ("", "&repair=true"))
    assert "iso-odd-top" in plain
    assert "iso-added-top" in repair and "iso-added-top" not in plain
    assert desk.http.post("/api/shapes/offers", data={**same, **change}).json() == {"offers": []}
    missing = desk.http.post("/api/shapes/offers", data={**same, "preview": "0" * 20})
    assert missing.status_code == 404
    many = desk.http.post("/api/shapes/offers", data={**same, "modules": "19999"})
    assert (many.status_code, many.json()["code"]) == (422, "too-many-modules")


@pytest.mark.parametrize(("preview_seconds", "waits_s"), [(300.0, 0.5), (5.0, None)])
def test_search_for_offers_ends_with_its_client_and_with_its_time(
    here_with: Callable[..., Service], preview_seconds: float, waits_s: float | None
) -> None:
    service = here_with(preview_seconds=preview_seconds).start()
    _, same = slab_without_a_path(service)
    (busy,) = service.children("preparer")
    busy.suspend()  # as one whose search goes on for ever
    if waits_s is None:
        late = service.http.post("/api/shapes/offers", data=same)
        assert (late.status_code, late.json()["code"]) == (504, "preview-too-slow")
    else:
        with pytest.raises(httpx.ReadTimeout):
            service.http.post("/api/shapes/offers", data=same, timeout=waits_s)
        # What another asks for has a child of its own.
        assert service.http.post("/api/shapes/offers", data=same).json()["offers"]
    assert not busy.is_running() or busy.status() == "zombie"


def test_gallery_card_under_on_a_table_folds_on_a_table(desk: Service) -> None:
    page = desk.http.get("/gallery?world=table").text
    assert 'action="/gallery/mallet-24?world=table"' in page
    answer = desk.http.post("/gallery/mallet-24?world=table", follow_redirects=False)
    assert answer.status_code == 303
    fold = answer.headers["location"].rpartition("/")[2]
    assert desk.http.get(f"/api/folds/{fold}").json()["world"] == "table"


@pytest.mark.parametrize("previewed", [False, True])
def test_mesh_folded_again_on_a_table_has_the_same_blocks(desk: Service, previewed: bool) -> None:
    data = trimesh.creation.torus(major_radius=10, minor_radius=4).export(file_type="stl")
    file = {"file": ("torus.stl", cast("bytes", data))}
    form = {"modules": "160"}
    if previewed:
        found = desk.http.post("/api/shapes/preview", files=file, data=form).json()
        made = desk.http.post("/api/folds", data={**form, "preview": found["id"]})
    else:
        made = desk.http.post("/api/folds", files=file, data=form)
    again = desk.http.post("/api/folds", data={"fold": made.json()["id"], "world": "table"})
    assert again.status_code == 202, again.text
    directory = desk.directory(again.json()["id"])
    assert json.loads((directory / "request.json").read_bytes())["method"] == "blocks"
