"""Facts: what a fold's page says about a fold, in the words of the page."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

from server.routes.finding import Found

RUNNING: Final = ("queued", "running")
DOWNLOADS: Final = (
    ("plan.json", "Plan", "JSON: joint angles, poses, certificate"),
    ("plan.npz", "Plan", "NumPy arrays, the same numbers"),
    ("model.xml", "Robot model", "MJCF for MuJoCo, with both keyframes"),
)


def fold_facts(found: Found, *, api: bool = True) -> dict[str, Any]:
    """Everything that the page shows besides the timeline, as JSON.

    Args:
        found: The fold.
        api: Whether the service's API is there for downloads and news.
    """
    row, directory = found.row, found.directory
    summary: dict[str, Any] = dict(row.summary or {})
    certificate = summary.get("certificate") or _json(directory / "certificate.json")
    running = row.status in RUNNING
    done = row.status in ("verified", "failed")
    problem = _problem(row, summary)
    downloads = [
        {"label": label, "hint": hint, "href": f"/api/folds/{row.id}/{name}"}
        for name, label, hint in DOWNLOADS
        if api and done and (directory / name).is_file()
    ]
    return {
        "id": row.id,
        "name": shown_name(row.name) or "New fold",
        "status": row.status,
        "running": running and api,
        "verdict": _verdict(row, summary, certificate),
        "cover": "Loading the view" if not running else "Waiting for the first frame",
        "problem": problem,
        "properties": _properties(row, summary, certificate, directory),
        "downloads": downloads,
        "downloads_hint": "The plan can be downloaded as soon as the fold is finished."
        if running
        else "There is nothing to download here.",
    }


def shown_name(name: str) -> str:
    """A name as people write it: ``wrench-160`` is a wrench, its size is told beside it."""
    if (sized := re.fullmatch(r"([a-z]+)-(\d+)", name)) is not None:
        return sized[1].capitalize()
    if (box := re.fullmatch(r"([a-z]+)-(\d+)x(\d+)x(\d+)", name)) is not None:
        return f"{box[1].capitalize()} {box[2]}×{box[3]}×{box[4]}"
    return name


def _verdict(row: Any, summary: dict[str, Any], certificate: dict[str, Any]) -> dict[str, str]:
    modules = f"{row.modules} modules" if row.modules else None
    if row.status == "verified":
        clearance = _number(certificate.get("min_clearance"), 2)
        parts = ["verified", f"clearance {clearance}" if clearance else None, modules]
        return {"tone": "good", "text": " · ".join(p for p in parts if p)}
    if row.status == "failed":
        reason = summary.get("reason") or (row.error or {}).get("detail")
        parts = ["not verified", reason, modules]
        return {"tone": "bad", "text": " · ".join(p for p in parts if p)}
    if row.status == "cancelled":
        return {"tone": "off", "text": "cancelled"}
    word = "in the queue" if row.status == "queued" else "computing"
    return {"tone": "busy", "text": " · ".join(p for p in (word, modules) if p)}


def _problem(row: Any, summary: dict[str, Any]) -> dict[str, str] | None:
    error = row.error or {}
    if row.status == "failed":
        text = error.get("detail") or summary.get("reason") or "No reason was recorded."
        where = f"{error['where']}: " if error.get("where") else ""
        return {"heading": "This fold could not be computed", "text": where + str(text)}
    if row.status == "cancelled":
        return {"heading": "This fold was cancelled", "text": "Nothing was computed to show."}
    return None


def _properties(
    row: Any, summary: dict[str, Any], certificate: dict[str, Any], directory: Path
) -> list[dict[str, str]]:
    explosion = summary.get("explosion") or {}
    playback = summary.get("playback") or {}
    chain = _json(directory / "chain.json")
    more = _json_head(directory / "plan.json")
    parts: list[tuple[str, Any]] = [
        ("Fold", row.id),
        ("Modules", row.modules),
        ("Joints", row.modules - 2 if row.modules else None),
        ("Pitch", _with(chain.get("pitch_m"), "m")),
        ("Module size", _with(_number(certificate.get("module_size"), 3), "pitches")),
        ("Preset", row.preset),
        ("Seed", summary.get("seed", row.seed)),
        ("Explosion steps", explosion.get("steps")),
        ("Explosion, wall time", _with(_number(explosion.get("seconds"), 2), "s")),
        ("Playback steps", playback.get("steps")),
        ("Playback, wall time", _with(_number(playback.get("seconds"), 2), "s")),
        ("Certificate, wall time", _with(_number(certificate.get("seconds"), 2), "s")),
        (
            "Final position error, RMS",
            _with(_number(playback.get("rms_position_error")), "pitches"),
        ),
        ("Largest joint error", _with(_number(playback.get("max_angle_error_rad")), "rad")),
        ("Least clearance", _with(_number(certificate.get("min_clearance"), 3), "pitches")),
        (
            "Least clearance, playback",
            _with(_number(certificate.get("min_clearance_playback"), 3), "pitches"),
        ),
        ("Largest joint step", _with(_number(certificate.get("max_joint_step_rad"), 3), "rad")),
        ("Peak torque", _with(_number(certificate.get("peak_torque_nm"), 3), "N m")),
    ]
    for name, value in {**more.get("parameters", {}), **more.get("versions", {})}.items():
        if isinstance(value, str | int | float):
            parts.append((str(name).replace("_", " ").capitalize(), value))
    return [{"label": k, "value": str(v)} for k, v in parts if v not in (None, "")]


def _number(value: Any, digits: int = 2) -> str | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return f"{value:.{digits}g}" if abs(value) < 0.01 else f"{value:.{digits}f}"


def _with(value: Any, unit: str) -> str | None:
    return None if value is None else f"{value} {unit}"


def _json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _json_head(path: Path) -> dict[str, Any]:
    """Parameters and versions of a plan, whose frames make it a long file."""
    found = _json(path)
    return {
        key: found[key] for key in ("parameters", "versions") if isinstance(found.get(key), dict)
    }
