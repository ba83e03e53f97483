"""Chains with a module of their own over HTTP."""

import json
from typing import Any

from tests.planner.chain.test_module_checks import RANGE, changed, document
from tests.server.service_process import Service

FREE = changed((RANGE, None))
"""A module whose hinge has no stop, so that linked modules would collide."""


def chain(module: dict[str, Any]) -> bytes:
    """Return a chain file with a module of its own."""
    values = {"format": "foldback-chain/1", "name": "bow", "joint_angles_deg": [30, 0, 30, 0]}
    return json.dumps({**values, "module": module}).encode()


def test_module_file_is_checked_over_http(service: Service) -> None:
    for values, code in ((document(), "module-alone"), (FREE, "unreachable-stop")):
        answer = service.upload("m.json", json.dumps(values).encode(), "/api/shapes/preview")
        assert (answer.status_code, answer.json()["code"]) == (422, code)
    answer = service.upload("m.json", chain(FREE), "/api/shapes/preview")
    assert (answer.status_code, answer.json()["code"]) == (422, "unreachable-stop")
