"""Preview reports: reports of uploads with given options, computed once on request."""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from foldback.planner.parameters.option import OPTIONS_KEY_CHARS
from foldback.planner.pipeline.request import PreviewRequest
from foldback.planner.storage.file_names import REQUEST
from foldback.planner.storage.files import sealed_json_of
from foldback.server.errors import ServiceError, TooMany, TooSlow, Unavailable
from foldback.server.files.uploads import Upload, not_read
from foldback.server.limits.disk_space import check_space
from foldback.server.processes.children import ChildError, Pool
from foldback.server.processes.scratch import READ_CONTENT
from foldback.server.settings import Settings
from foldback.server.store.folds import new_id
from foldback.server.store.owner import Owner
from foldback.server.store.previews import NoSuchPreviewError, Previews
from foldback.server.store.schema import PreviewRow

OPTIONS_KEY: Final = re.compile(f"[0-9a-f]{{{OPTIONS_KEY_CHARS}}}")
MAX_OPTION_SETS: Final = 400
"""Maximum number of sets of options for which previews of one upload are stored. The uploader and
all other visitors together each have this number; further sets are refused."""
MANY_TRIANGLES: Final = 300_000
"""Number of triangles of a mesh above which reading and sampling it, rather than the search for a
path, take most of the time of a preview."""
REPORT: Final = "report.json"
"""Name of the file with a report."""
OFFERS_FILE: Final = "offers.json"
"""Name of the file, in the directory of a report, with the variants of the shape that can fold on
a table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asker:
    """Client that waits for a report.

    Attributes:
        visitor: Pseudonym of the visitor.
        has_disconnected: Polled; returns True if it has disconnected.
    """

    visitor: str
    has_disconnected: Callable[[], bool] = lambda: False


class PreviewReports:
    """Reports of uploads with given options. Thread-safe.

    Args:
        settings: The settings.
        previews: Store of the uploads.
        reader: Processes that compute reports.
    """

    def __init__(self, settings: Settings, previews: Previews, reader: Pool) -> None:
        self._settings = settings
        self._previews = previews
        self._reader = reader

    def close(self) -> None:
        """End the processes."""
        self._reader.close()

    def add(self, upload: Upload, visitor: str, owner: Owner | None = None) -> str:
        """Store a visitor's upload; return its id, which cannot be guessed.

        Raises:
            NoRoom: If the disk has no room for it.
            StorageError: If the storage does not respond.
        """
        now = time.time()
        row = PreviewRow(
            id=new_id(),
            visitor=visitor,
            owner=owner and owner.digest,
            filename=upload.filename,
            created_at=now,
            seen_at=now,
        )
        self._previews.add(row, upload.directory)
        return row.id

    def report(self, preview_id: str, options: PreviewRequest, asker: Asker) -> dict[str, Any]:
        """Return the report of an upload with these options; it is computed once.

        A quick request gets the final report where there is one already, or where the first result
        is the final one; it is stored as that of the complete request.

        Args:
            preview_id: Id of the upload.
            options: Options with which it is turned into a path.
            asker: Client that requests it.

        Raises:
            NoSuchPreviewError: If there is no such upload.
            ServiceError: If it cannot be used, takes too long, or too many wait.
        """
        row = self._previews.row(preview_id)
        place = self._previews.place(preview_id, options.key)
        complete = place
        if options.quick:
            complete = self._previews.place(preview_id, options.complete.key)
        self._previews.touch(row)
        if (stored_report := read_report(complete) or read_report(place)) is not None:
            return stored_report
        foreign = asker.visitor != row.visitor
        if self._previews.reports(preview_id, foreign=foreign) >= MAX_OPTION_SETS:
            raise TooMany(
                "too-many-previews",
                "This file was previewed with {limit} different sets of options, the maximum; send "
                "the file again to start a new preview.",
                retry_after_s=60,
                limit=MAX_OPTION_SETS,
            )
        check_space(self._settings.previews_dir, self._settings.min_free_disk_bytes)
        request = {"filename": row.filename, **options.to_json()}
        request["time_limit_s"] = self._settings.preview_search_seconds
        place.mkdir(exist_ok=True)
        (place / REQUEST).write_text(json.dumps(request))
        try:
            self._compute("preview", place, asker)
            if place != complete and (read_report(place) or {}).get("final"):
                place = _moved(place, complete)
        finally:
            self._previews.keep_report(place, foreign=foreign)
        stored_report = read_report(place)
        if stored_report is None and asker.has_disconnected():
            raise Unavailable("gone", "The preview was cancelled, because its client disconnected.")
        if stored_report is None:
            raise NoSuchPreviewError(preview_id)
        return stored_report

    def offers(self, preview_id: str, options: PreviewRequest, asker: Asker) -> dict[str, Any]:
        """Return versions of an upload that can fold on a table; searched once.

        There are none in a world without gravity, or if the shape has a path as it is.

        Args:
            preview_id: Id of the upload.
            options: Options of the preview that found no path.
            asker: Client that requests them; the search ends when it disconnects.

        Raises:
            NoSuchPreviewError: If there is no such upload.
            ServiceError: If it cannot be used, takes too long, or too many wait.
        """
        report = self.report(preview_id, options, asker)
        if options.world != "table" or report["has_path"]:
            return {"offers": []}
        place = self._previews.place(preview_id, options.key)
        if sealed_json := sealed_json_of(place / OFFERS_FILE):
            return sealed_json
        try:
            self._compute("offers", place, asker)
        except (TooSlow, Unavailable):
            if not (place / OFFERS_FILE).is_file():
                raise
        sealed_json = sealed_json_of(place / OFFERS_FILE)
        if not sealed_json:
            raise Unavailable("gone", "The search was cancelled, because its client disconnected.")
        foreign = asker.visitor != self._previews.row(preview_id).visitor
        self._previews.keep_report(place, foreign=foreign)
        return sealed_json

    def _compute(self, task: str, place: Path, asker: Asker) -> None:
        """Run a task in the directory of a report.

        Raises:
            ServiceError: If the upload cannot be used, or too many wait.
            TooSlow: If it takes too long.
        """
        try:
            self._reader.call(task, place, visitor=asker.visitor, cancelled=asker.has_disconnected)
        except ChildError as error:
            raise _problem(error, self._settings.preview_seconds, place) from None


def read_report(place: Path) -> dict[str, Any] | None:
    """Return the report in a directory of options, if it exists."""
    report = sealed_json_of(place / REPORT)
    # That of an earlier version does not describe its module.
    return report if "module_value" in report else None


def _moved(place: Path, target: Path) -> Path:
    """Move the files of a report to another directory, the report last; return that directory."""
    target.mkdir(exist_ok=True)
    for path in sorted(place.iterdir(), key=lambda path: path.name == REPORT):
        with suppress(FileNotFoundError):  # another request for the same report has moved it
            path.replace(target / path.name)
    shutil.rmtree(place, ignore_errors=True)
    return target


def cells_of_repair(place: Path) -> list[list[int]]:
    """Return the cells that the repair among the offers in a directory of options adds."""
    offers = sealed_json_of(place / OFFERS_FILE).get("offers", [])
    return next((offer["added"] for offer in offers if offer["added"]), [])


def _problem(error: ChildError, seconds: float, place: Path) -> ServiceError:
    if error.code != "time-limit":
        return not_read(error)
    code, too_long = "preview-too-slow", "took longer than the time limit of {limit_s:g} s"
    if not (place / READ_CONTENT).is_file():
        template = f"reading the file {too_long}; simplify the model."
        return TooSlow(code, template, limit_s=seconds)
    triangles = json.loads((place / READ_CONTENT).read_text())["triangles"]
    if triangles > MANY_TRIANGLES:
        return TooSlow(
            code,
            f"the preview {too_long}, because the mesh has {{triangles}} triangles; simplify the "
            "mesh to {limit} triangles or fewer.",
            limit_s=seconds,
            triangles=triangles,
            limit=MANY_TRIANGLES,
        )
    return TooSlow(
        code,
        f"the preview {too_long}; use fewer modules, or the method 'blocks'.",
        limit_s=seconds,
    )
