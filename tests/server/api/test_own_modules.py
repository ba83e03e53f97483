"""Chains with a module of their own over HTTP."""

import json
import re
from typing import Any

import numpy as np

from foldback.planner.chain.module_file import module_schema
from foldback.planner.plan.plan import Plan
from tests.planner.chain.test_module_checks import RANGE, changed, document
from tests.server.service_process import Service

FREE = changed((RANGE, None))
"""A module whose hinge has no stop, so that linked modules would collide."""


def chain(module: dict[str, Any]) -> bytes:
    """Return a chain file with a module of its own."""
    values = {"format": "foldback-chain/1", "name": "bow", "joint_angles_deg": [30, 0, 30, 0]}
    return json.dumps({**values, "module": module}).encode()


def test_chain_with_its_own_module_is_previewed_and_folded(service: Service) -> None:
    report = service.upload("bow.json", chain(document()), "/api/shapes/preview").json()
    assert (report["module"], report["modules"], report["has_path"]) == ("slab", 5, True)
    answer = service.upload("bow.json", chain(document()))
    assert answer.status_code == 202, answer.text
    fold = service.wait_over(answer.json()["id"])
    assert fold["status"] == "verified"
    plan = Plan.load(service.data_dir / "folds" / fold["id"] / "plan.npz")
    assert plan.chain.module.document == document()
    np.testing.assert_allclose(np.rad2deg(plan.chain.folded_rad), [30, 0, 30, 0])


def test_schema_of_module_files_is_published(service: Service) -> None:
    page = service.http.get("/").text
    (address,) = re.findall(r'href="([^"]+module\.schema\.json)"', page)
    assert service.http.get(address).json() == json.loads(json.dumps(module_schema()))


def test_module_file_is_checked_over_http(service: Service) -> None:
    for values, code in ((document(), "module-alone"), (FREE, "unreachable-stop")):
        answer = service.upload("m.json", json.dumps(values).encode(), "/api/shapes/preview")
        assert (answer.status_code, answer.json()["code"]) == (422, code)
    answer = service.upload("m.json", chain(FREE), "/api/shapes/preview")
    assert (answer.status_code, answer.json()["code"]) == (422, "unreachable-stop")
