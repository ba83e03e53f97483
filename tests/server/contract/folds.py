"""Folds in every state, made without computing: rows, and files of the shipped folds."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.storage.files import settle
from foldback.server.errors import UNEXPECTED_WORDS
from foldback.server.store.folds import Store
from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR
from tests.server.rows import a_fold
from tests.server.service_process import SNAKE
from tests.words.test_certificate import SIMULATED

DAY = 1_700_000_000.0
"""Time of all requests, s since 1970."""
REASON = (
    "in the plan, modules 3 and 7 overlap by 0.02 pitch at module size 0.95, 40 % through the "
    "motion (frame 12.5 of the plan)"
)
OVERLAP = {
    "code": "overlap",
    "values": {"motion": "plan", "modules": [3, 7], "depth": 0.02, "module_size": 0.95}
    | {"progress": 0.4, "frame": 12.5},
}
KNOT = {"kind": "knot", "modules": [5, 6, 9], "words": "its path is knotted.", "evidence": None}
ATTEMPTS = [
    {"candidate": 0, "seed": 0, "strategy": "simultaneous", "status": "stalled", "steps": 900}
    | {"seconds": 2.5, "stuck": KNOT},
    {"candidate": 0, "seed": 0, "strategy": "peel", "status": "stalled", "steps": 120}
    | {"seconds": 4.0, "stuck": {"kind": "budget", "modules": [3], "words": "time was up."}},
]
FIGURES = {**SIMULATED, "module_size": 0.95, "fold_time_s": 17.7}
SUMMARY = {"explosion": {"strategy": "simultaneous", "frames": 211, "steps": 200}, "hinges": 28}

SHIPPED = {"pawn": "pawn", "cube": "tetra-cube-2", "refold": "wrench-80-to-mallet-80"}
"""Names of the shipped folds by the ids that they get here."""

ROWS: Mapping[str, Mapping[str, Any]] = {
    "queued": {"status": "queued", "name": "wrench-16", "world": "table"},
    "running": {
        "status": "running",
        "stage": "explode",
        "progress": {"stage": "explode", "fraction": 0.25, "frames": 40},
        "prefer": "time",
    },
    "unreadable": {
        "stage": "read",
        "error": {
            "code": "not-adjacent",
            "values": {"cells": [1, 2]},
            "detail": "got a gap.",
            "message": "cells 2 and 3: got a gap.",
            "where": "cells 1 and 2",
        },
    },
    "knotted": {
        "stage": "explode",
        "summary": {**SUMMARY, "reason": "the path is knotted", "stuck": KNOT},
        "seed": 7,
    },
    "stopped": {
        "stage": "play_back",
        "preset": "paper",
        "settings": "damping=0.05,radial_gain=0.2",
        "error": {"code": "time-limit", "detail": "the playback took long."},
    },
    "refuted": {
        "stage": "certify",
        "module_size": 0.99,
        "summary": {
            **SUMMARY,
            "reason": REASON,
            "certificate": {**FIGURES, "verified": False, "reason": OVERLAP},
        },
        "error": {"code": "not-verified", "detail": REASON},
    },
    "unwritten": {
        "stage": "export",
        "error": {
            "code": "internal",
            "detail": UNEXPECTED_WORDS,
        },
    },
    "cancelled": {"status": "cancelled", "cancel_requested": True, "strategy": "peel"},
    "smoothed": {
        "status": "verified",
        "smooths": "pawn",
        "renamed": True,
        "name": "My <pawn> & me",
        "summary": {**SUMMARY, "status": "verified", "certificate": FIGURES},
    },
}
"""Values of the invented rows by their ids."""
NAMES = (*SHIPPED, *ROWS)
"""Ids of all folds."""


def add_folds(store: Store) -> None:
    """Add all folds to a store that has none of them."""
    for fold_id, name in SHIPPED.items():
        directory = store.directory(fold_id)
        directory.mkdir(parents=True)
        about = unpack((SHIPPED_FOLDS_DIR / f"{name}.fold").read_bytes(), directory)
        settle(directory)
        summary = about["summary"]
        expected = {key: summary[key] for key in ("module", "modules", "preset", "seed")}
        shape = about["shape"] if about["refold"] is None else None
        shipped = {**summary, "shipped": {"version": about["version"]}}
        fold_values = expected | {
            "public": True,
            "pinned": True,
            "shape": shape,
            "summary": shipped,
        }
        _add(store, fold_id, name=about["name"], refold=about["refold"], **fold_values)
    for fold_id, fold_values in ROWS.items():
        _add(store, fold_id, **{"status": "failed", **fold_values})
    directory = store.directory("knotted")
    (directory / "attempts.json").write_text(json.dumps(ATTEMPTS))
    (store.directory("queued") / "cells.json").write_text(json.dumps(SNAKE))


def _add(store: Store, fold_id: str, **values: Any) -> None:
    Path(store.directory(fold_id)).mkdir(parents=True, exist_ok=True)
    row = a_fold(fold_id, **{"created_at": DAY, "ended_at": DAY, "seen_at": DAY, **values})
    with store.changing() as session:
        session.add(row)
