"""Folds on a table: requested over HTTP, reported in their JSON and on their pages."""

from io import BytesIO
from typing import Any

import httpx
import numpy as np
import pytest

from foldback.server.processes import children
from tests.server.service_process import Service, check_problem
from tests.server.service_thread import ServiceWith
from tests.web.timeline.decoding import decode

SLAB = [[x, y, 0] for x in range(3) for y in range(3) if (x, y) != (1, 0)]
"""Cells of a slab that has no path: one of its chessboard colours has two more cells."""


def voxels(*sides: int) -> bytes:
    file = BytesIO()
    np.save(file, np.ones(sides, bool))
    return file.getvalue()


def get_json(idle: Service, path: str = "/api/folds", **form: str) -> Any:
    data = None if {"shape", "fold"} & set(form) else voxels(2, 2, 2)
    return idle.upload("box.npy", data, path, **form)


def test_options_that_do_not_suit_a_table_are_refused(idle: Service) -> None:
    """tests/planner/pipeline/test_settings.py has all of them."""
    for form, words in (
        ({"shape": "tetra-ring"}, "got a chain of tetrahedra for a fold on a table"),
        ({"start": "0,0,0"}, "got a start cell"),
    ):
        fold = get_json(idle, world="table", **form)
        assert words in check_problem(fold, 422, "unsuited-world")
    preview = get_json(idle, "/api/shapes/preview", world="table", start="0,0,0")
    assert preview.json() == fold.json()


def test_settings_and_paths_that_do_not_suit_the_world_are_refused(idle: Service) -> None:
    assert (
        "for a fold in the 'floating' world"
        in get_json(idle, settings="table_torque=3").json()["detail"]
    )
    assert get_json(idle, world="table", settings="table_torque=0").json()["code"] == "bad-settings"
    over = [[0, 0, 1], [1, 0, 1], [2, 0, 1], [2, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]]
    answer = idle.upload("over.json", str(over), world="table")
    assert len(check_problem(answer, 422, "not-for-a-table")) < 800


def test_preview_for_a_table_has_a_path_of_its_own(idle: Service) -> None:
    preview = get_json(idle, "/api/shapes/preview", world="table").json()
    assert preview["has_path"] and preview["method"] == "table"
    assert preview["expected_s"] > get_json(idle, "/api/shapes/preview").json()["expected_s"]


@pytest.mark.slow
def test_fold_on_a_table_shows_its_torque_and_forces(service: Service) -> None:
    accepted = get_json(service, world="table", settings="table_torque=9").json()
    resting = service.wait_over(accepted["id"])
    assert (resting["status"], resting["world"]) == ("verified", "table")
    table = resting["summary"]["certificate"]["table"]
    assert table["bound"] == 9.0
    assert 0.0 <= table["torque"] <= 9.0
    under = f"/folds/{resting['id']}"
    facts = service.http.get(f"{under}/facts").json()
    shown_table = facts["table"]
    assert shown_table["good"]
    assert shown_table["text"].startswith("The chain stays on the table; its hinges need at most ")
    assert len(shown_table["assumptions"]) == len(table["assumptions"])
    assert ["Torque limit", "9 w·p"] in shown_table["rows"]
    assert "How often the simulation of unfolding went back to an earlier frame" in [
        row_label for row_label, _ in shown_table["rows"]
    ]
    assert (
        " but not much wider, these servos suit them:" in shown_table["servos"]
        and shown_table["named"]
    )
    (floating, second) = facts["compare"]
    assert floating["form"] == {"fold": resting["id"], "seed": 0, "settings": ""}
    assert (second["form"]["world"], second["form"]["settings"]) == ("table", "table_torque=9")
    assert not facts["refoldable"] and not facts["smooth_question"]
    header, curves = decode(service.http.get(f"{under}/figures").content)
    assert (header["table"]["words"], header["table"]["bound"]) == ("without friction", 9.0)
    assert "peak_torque_nm" not in curves
    assert np.nanmax(curves["table_torque"]) == pytest.approx(table["torque"], abs=1e-5)
    part = {"part": (header["frames"] - 1) // header["rows"]}
    _, last = decode(service.http.get(f"{under}/figures", params=part).content)
    assert last["pressed"][-1].sum() == pytest.approx(8.0, abs=1e-3)
    bundle, _ = decode(service.http.get(f"{under}/bundle").content)
    assert bundle["table"]["height"] == pytest.approx(-0.5)
    assert '"forces":' in service.http.get(f"{under}/standalone.html").text


def slab_without_a_path(service: Service) -> tuple[dict[str, Any], dict[str, str]]:
    """Preview a slab that has no path for a table; return its report and the same options."""
    form = {"world": "table", "as_voxels": "true"}
    none = service.preview("slab.json", str(SLAB), **form)
    assert not none["has_path"]
    return none, {**form, "preview": none["id"]}


def test_offers_for_a_shape_without_a_path_lead_to_a_preview_with_one(idle: Service) -> None:
    none, same_slab = slab_without_a_path(idle)
    (problem,) = none["feasibility"]["problems"]
    assert problem["detail"].startswith(
        "if the cells are coloured like a chessboard, 5 are black and 3 are white"
    )
    assert set(map(tuple, problem["cells"])) <= set(map(tuple, none["cells"]))
    offers = idle.http.post("/api/shapes/offers", data=same_slab).json()["offers"]
    assert [offer["kind"] for offer in offers] == ["repair", "blocks"]
    change = {k: v for k, v in offers[0]["change"].items() if v is not None}
    better = idle.preview(**same_slab, **change)
    assert better["has_path"]
    assert better["modules"] == offers[0]["modules"] == len(SLAB) + len(offers[0]["added"])
    # Proposed cells, and those that were added, have colours of their own.
    assert sorted(map(tuple, better["added"])) == sorted(map(tuple, offers[0]["added"]))
    path = f"/previews/{none['id']}"
    for address, extra, mark in (
        (f"{path}/scene/{none['key']}", "?repair=true", b"/added"),
        (f"{path}/drawing.svg?key={none['key']}", "&repair=true", b"iso-added-top"),
    ):
        assert mark in idle.http.get(address + extra).content
        assert mark not in idle.http.get(address).content
    assert idle.http.post("/api/shapes/offers", data={**same_slab, **change}).json() == {
        "offers": []
    }
    missing = idle.http.post("/api/shapes/offers", data={**same_slab, "preview": "0" * 20})
    assert missing.status_code == 404
    answer = idle.http.post("/api/shapes/offers", data={**same_slab, "modules": "19999"})
    assert (answer.status_code, answer.json()["code"]) == (422, "too-many-modules")


def test_refused_cells_name_the_nearest_ones_with_a_path(idle: Service) -> None:
    form = {"as_voxels": "true", "method": "exact"}
    refused = idle.upload("slab.json", str(SLAB), **form)
    assert "for 9 modules, or remove the cell" in check_problem(refused, 422, "no-path")
    refused = idle.upload("slab.json", str(SLAB), world="table", as_voxels="true")
    nearest = "Possible repair: add the cell (1, 0, 0), for 9 modules."
    assert nearest in check_problem(refused, 422, "no-path")


def test_search_for_offers_ends_with_its_client_and_with_its_time(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "BUSY_FACTOR", 2.0)
    service = service_with(preview_seconds=1.5).start()
    for timeout in (60.0, 0.5):
        _, same_slab = slab_without_a_path(service)
        (busy,) = service.children("preparer")
        busy.suspend()  # simulates a search that never ends
        if timeout > 1.5:
            check_problem(service.http.post("/api/shapes/offers", data=same_slab), 503, "busy")
        else:
            with pytest.raises(httpx.ReadTimeout):
                service.http.post("/api/shapes/offers", data=same_slab, timeout=timeout)
            # Another client's request has a child of its own.
            assert service.http.post("/api/shapes/offers", data=same_slab).json()["offers"]
        assert not busy.is_running() or busy.status() == "zombie"


def test_gallery_for_a_table_folds_on_a_table(idle: Service) -> None:
    assert 'href="/gallery/mallet-24?world=table"' in idle.http.get("/gallery?world=table").text
    answer = idle.http.post("/gallery/mallet-24?world=table", follow_redirects=False)
    assert answer.status_code == 303
    assert idle.state(answer.headers["location"].rpartition("/")[2])["world"] == "table"
