"""Shipped folds: finished folds in the package, which a new service displays.

``examples/make_shipped_folds.py`` creates them. Each is imported only once into a database: if an
operator deletes one, it stays deleted. They have no owner and do not count in any quota.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.readers.gallery import Gallery
from foldback.planner.storage.files import settle
from foldback.server.files.uploads import Upload
from foldback.server.processes.scratch import Scratch
from foldback.server.settings import Settings
from foldback.server.store.folds import Store, new_id
from foldback.server.store.owner import Owner
from foldback.server.store.schema import CounterRow, FoldRow
from foldback.server.submission.fold_inputs import Source
from foldback.server.submission.submit import Submission

SHIPPED_FOLDS_DIR: Final = Path(str(files("foldback.server"))) / "shipped_folds"
SERVICE_VISITOR: Final = "the service itself"
log = logging.getLogger("foldback.service")


def import_shipped_folds(settings: Settings, store: Store, gallery: Gallery) -> Sequence[str]:
    """Import the finished folds that this database has not had yet; return their names.

    One that cannot be imported, as on a full disk, is left for the next start.
    """
    names: list[str] = []
    scratch = Scratch(settings.scratch_dir)
    for path in sorted(SHIPPED_FOLDS_DIR.glob("*.fold")):
        try:
            if _import(path, store, gallery, scratch):
                names.append(path.stem)
        except Exception:  # shipped folds must not prevent the start of the service
            log.exception("the finished fold %s could not be imported", path.stem)
    return names


def _import(path: Path, store: Store, gallery: Gallery, scratch: Scratch) -> bool:
    mark = f"finished {path.stem}"[:32]
    with store.reading() as session:
        if session.get(CounterRow, mark) is not None:
            return False
    with scratch.directory() as place:
        folder = place / "fold"
        folder.mkdir()
        about = unpack(path.read_bytes(), folder)
        settle(folder)
        key = _content_key(about, folder, gallery)
        fold_id = new_id()
        store.folders.adopt(folder, fold_id)
    try:
        with store.changing() as session:
            session.add(CounterRow(name=mark, value=1))
            session.flush()
            same_key = sa.select(FoldRow.id).where(FoldRow.content_key == key)
            is_wanted = key is None or session.scalar(same_key) is None
            if is_wanted:  # otherwise the same fold exists already
                session.add(_row(fold_id, about, key))
    except IntegrityError:  # another process was faster
        is_wanted = False
    except BaseException:
        store.folders.remove(fold_id)
        raise
    if not is_wanted:
        store.folders.remove(fold_id)
    return is_wanted


def _content_key(about: dict[str, Any], folder: Path, gallery: Gallery) -> str | None:
    """Return the content key with which a request for the same fold finds it.

    It is None for a refold, whose request names an initial fold, and if the gallery now has another
    shape of this name.
    """
    shape = gallery.shape(str(about["shape"]))
    if about["refold"] is not None or shape is None:
        return None
    if (folder / "input").read_bytes() != shape.data:
        return None
    digest = sha256(shape.data).hexdigest()
    submission = Submission(
        upload=Upload(directory=folder, filename=shape.filename, digest=digest),
        source=Source(
            request=FoldRequest(preset=about["summary"]["preset"], seed=about["summary"]["seed"]),
            shape=shape.name,
        ),
        visitor=SERVICE_VISITOR,
        owner=Owner(""),
    )
    return submission.content_key


def _row(fold_id: str, about: dict[str, Any], content_key: str | None) -> FoldRow:
    """Return the row of a finished fold, which counts in no quota and never expires."""
    now, summary = time.time(), about["summary"]
    return FoldRow(
        id=fold_id,
        name=about["name"],
        status="verified",
        stage="export",
        created_at=now,
        ended_at=now,
        modules=summary["modules"],
        module=summary["module"],
        module_words=summary.get("module_words"),
        shape=about["shape"] if about["refold"] is None else None,
        public=True,
        pinned=True,
        preset=summary["preset"],
        seed=summary["seed"],
        content_key=content_key,
        visitor=SERVICE_VISITOR,
        summary={**summary, "shipped": {"version": about["version"]}},
        refold=about["refold"],
    )
