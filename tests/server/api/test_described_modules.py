"""Chains of modules that their files describe: pages and lists call them by their words."""

from __future__ import annotations

import json

from foldback.planner.chain.built_in_modules import module_named
from tests.server.service_process import Service

WORDS = {"singular": "wedge", "plural": "wedges"}
MODULE = {**module_named("snake-prism").document, "name": "wedge", "words": WORDS}
BOW = {
    **{"format": "foldback-chain/1", "name": "bow", "module": MODULE},
    "joint_angles_deg": [0, 0, 90, 0, 0, -90, 0],
}
TOKEN = "a-token-for-described-modules"


def test_lists_and_pages_call_described_modules_by_their_words(idle: Service) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}"}

    def posted(path: str) -> dict[str, object]:
        file = {"file": ("bow.json", json.dumps(BOW).encode())}
        answer = idle.http.post(path, files=file, headers=headers)
        assert answer.is_success, answer.text
        return dict(answer.json())

    preview = posted("/api/shapes/preview")
    stated = (preview["module"], preview["module_words"], preview["follows_paths"])
    assert stated == ("wedge", WORDS, False)
    (listed,) = idle.http.get("/api/mine/previews", headers=headers).json()["previews"]
    assert listed["module_words"] == WORDS
    assert "<path" in idle.http.get(listed["drawing"]).text

    fold_id = posted("/api/folds")["id"]
    (listed,) = idle.http.get("/api/mine/folds", headers=headers).json()["folds"]
    assert (listed["id"], listed["module"], listed["module_words"]) == (fold_id, "wedge", WORDS)
    assert "8\N{NO-BREAK SPACE}wedges" in idle.http.get(f"/folds/{fold_id}").text


def test_words_are_text_on_pages(idle: Service) -> None:
    words = {"singular": "<script>", "plural": "<script>alert(1)</script>"}
    hostile = {**BOW, "module": {**MODULE, "words": words}}
    file = {"file": ("bow.json", json.dumps(hostile).encode())}
    fold_id = idle.http.post("/api/folds", files=file).json()["id"]
    page = idle.http.get(f"/folds/{fold_id}").text
    assert "&lt;script&gt;alert" in page and "<script>alert" not in page


def test_described_module_takes_no_shipped_name(idle: Service) -> None:
    named_cube = {**BOW, "module": {**MODULE, "name": "cube"}}
    file = {"file": ("bow.json", json.dumps(named_cube).encode())}
    answer = idle.http.post("/api/folds", files=file)
    assert (answer.status_code, answer.json()["code"]) == (422, "name-taken")
