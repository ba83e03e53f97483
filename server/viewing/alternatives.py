"""Alternatives: verified plans of a fold that were not selected, displayed like folds.

The id of an alternative is the fold's id with the number of the attempt, from 0: ``abc-3``. It can
be viewed and compared, but has no files to download and no jobs.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import cast

from foldback.planner.certificate.figures import AttemptFigures, CertificateFigures, FoldSummary
from foldback.planner.errors import UNREADABLE
from foldback.planner.pipeline.preference import COMPUTING
from foldback.planner.storage.file_names import ATTEMPTS, CERTIFICATE, CHAIN, PLANS_DIR
from foldback.planner.storage.files import json_of
from foldback.server.store.fold_source import LocatedFold
from foldback.words.fold import RUNNING_STATUSES


def alternative(located: LocatedFold, number: str) -> LocatedFold | None:
    """Return another plan of a fold as something to show; None if it is not stored.

    Args:
        located: The fold.
        number: Number of the attempt as a text, counted from 0.
    """
    if (
        located.row.status in RUNNING_STATUSES
        or not number.isdecimal()
        or len(number) > 3  # folds have at most a few dozen
    ):
        return None
    directory = located.directory / PLANS_DIR / str(int(number))
    if not (directory / CHAIN).is_file():
        return None
    try:
        attempts = json.loads((located.directory / ATTEMPTS).read_bytes())
        attempt = cast("AttemptFigures", attempts[int(number)])
    except (IndexError, *UNREADABLE):
        return None
    certificate = cast("CertificateFigures", json_of(directory / CERTIFICATE))
    summary: FoldSummary = {
        "seed": attempt["seed"],
        "explosion": {"strategy": attempt["strategy"]},
        "playback": {"kind": "dynamic" if certificate.get("simulated") else "kinematic"},
        "certificate": certificate,
    }
    row = replace(
        located.row,
        id=f"{located.row.id}-{int(number)}",
        name=f"{located.row.title}, plan {int(number) + 1}",
        renamed=True,
        status="verified",
        prefer=COMPUTING,
        refold=None,
        smooths=None,
        summary=summary,
    )
    return LocatedFold(row, directory, alternative_to=located.row.id)
