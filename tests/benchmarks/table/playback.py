"""Playback on the table: how closely limited motors fold what an explosion on it has recorded.

``python -m tests.benchmarks --only table-playback``.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.certificate.table import table_certificate
from planner.certificate.table_figures import FRICTIONLESS, TableCertificate
from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.explosion.table import explode_on_table
from planner.motion.windows import Windows
from planner.playback.table_playback import play_on_table
from planner.simulation.parameters import TableParameters
from planner.table_paths.table_paths import table_paths
from planner.verification.table_replay import table_replay
from tests.benchmarks.table.paths import gallery_cells
from tests.benchmarks.tables import Section

Cells = NDArray[np.int64]
BOXES: Final = {"3×3×3": (3, 3, 3), "4×4×2": (4, 4, 2)}
NAMED: Final = ("mallet-24", "mallet-64", "letter-f")
ATTEMPTS: Final = 8
"""Paths, each with a seed of its own, until one explosion ends straight."""
STRONGER: Final = 1.5
"""Limit of the motors, of the certificate's torque."""
LEAST_WP: Final = 1.0
"""Limit of motors of plans whose certificate asks for hardly anything."""
BAR, STRETCH = 0.05, 0.01


def table_playback(reference_seconds: float) -> Section:
    """Boxes and solids that lie down on the table and are folded there again."""
    del reference_seconds
    section = Section(name="table-playback")
    for name, cells in _shapes().items():
        _shape(section, name, cells)
    return section


def _shapes() -> dict[str, Cells]:
    boxes = {name: np.argwhere(np.ones(sides, dtype=bool)) for name, sides in BOXES.items()}
    gallery = dict(gallery_cells(64))
    return {**boxes, **{name: gallery[name] for name in NAMED}}


def _shape(section: Section, name: str, cells: Cells) -> None:
    found = _exploded(name, cells)
    if found is None:
        section.add(f"{name}: playback", f"no explosion of {ATTEMPTS} ended straight", "", False)
        return
    chain, record, certificate = found
    torque = max(certificate.torque or 0.0, LEAST_WP)
    played = play_on_table(chain, record, torque_limit_wp=STRONGER * torque)
    rests = table_replay(chain, record, torque=torque)
    section.rows.append(
        {
            "shape": name,
            "modules": len(chain),
            "certified_wp": certificate.torque,
            "status": played.status,
            "rms_pitches": played.rms_error,
            "end_pitches": played.final_error,
            "most_rad": played.largest_error_rad,
            "limit_wp": played.torque_limit,
            "torque_wp": played.largest_torque,
            "at_limit": played.hinge_share_at_limit,
            "time": played.duration,
            "s": played.seconds,
            "replay_pitches": max(rests.drifts),
        }
    )
    section.add(
        f"{name}: RMS of positions, motors of {STRONGER:g} times the certificate, {FRICTIONLESS}",
        f"{played.rms_error:.4f} pitches, {played.status}",
        f"≤ {BAR:g} (stretch {STRETCH:g})",
        played.status == "folded" and played.rms_error <= BAR,
    )
    section.add(
        f"{name}: {len(rests.frames)} frames let go in plain MuJoCo, servos of 1.1 times it",
        f"gone by {max(rests.drifts):.3f} pitches at most",
        "still",
        rests.holds,
    )


def _exploded(name: str, cells: Cells) -> tuple[Chain, Windows, TableCertificate] | None:
    paths = table_paths(cells, most=ATTEMPTS)
    for seed in range(ATTEMPTS):
        path = Path.from_cells(paths[seed % len(paths)].cells, name=name)
        chain = Chain.from_path(path)
        record = explode_on_table(chain, TableParameters(), seed=seed)
        if record.status == "straight":
            assert isinstance(record.frames, Windows)
            certificate = table_certificate(
                chain, record.frames[::-1], on_table=True, height=chain.table_height
            )
            return chain, record.frames, certificate
    return None
