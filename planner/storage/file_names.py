"""File names: the files in the directory of a fold.

They stand here, in the lowest layer, so that a program can find a file without what computes it.
"""

from __future__ import annotations

from typing import Final

INPUT: Final = "input"
REQUEST: Final = "request.json"
CANDIDATES: Final = "candidates.json"
PREPARED: Final = "prepared.json"
"""Name of the file in which a preview stores the chains that it found in an input, so that the fold
need not search for them again."""
START_CHAIN: Final = "start.json"
"""Name of the file that describes the chain of an earlier, finished fold, in the directory of a
fold that starts from it: a refold (the chain unfolds, then folds into another shape), or a
smoothing of its plan."""
START_PLAN: Final = "start.npz"
"""Name of the file with the plan of an earlier, finished fold, in the directory of a refold (the
folded chain unfolds by this plan in reverse, then folds into another shape)."""
RECORDED_PLAN: Final = "recorded.npz"
"""Name of the file with the plan that is smoothed, in the directory of a fold that smooths the
motion of an earlier fold or of one of its own attempts."""
CHAIN: Final = "chain.json"
ATTEMPTS: Final = "attempts.json"
TIMELINE: Final = "timeline"
RECORD: Final = "record.npz"
PLAYBACK: Final = "playback.npz"
CERTIFICATE: Final = "certificate.json"
FORCES: Final = "table.npz"
"""Name of the file with the hinge torques and contact forces at each frame of a fold on a table."""
PLAN: Final = "plan.npz"
PLAN_TEXT: Final = "plan.json"
"""Name of the file with a plan's values as text, which is written when somebody asks for it."""
MODEL: Final = "model.xml"
FIGURES: Final = "figures"
ARRAY_FOLDERS: Final = (TIMELINE, FIGURES)
"""Folders with arrays, see ``planner.storage.array_files``."""
MOMENTS: Final = "moments.json"
"""Name of the file with the moments of a fold that a tour shows besides those of its
certificate."""
TOUR: Final = "tour.json"
"""Name of a file with a tour in a fold's directory, which ``foldback play`` shows in place of a
draft."""
OWN_VALUES: Final = "values.json"
"""Name of a file with numbers for modules in a fold's directory, which ``foldback play`` and
``foldback site`` offer as colours."""
VERDICT: Final = "verdict.json"
"""Name of the file that states whether turns of single joints lead to a figure at full size."""
EXHAUSTION: Final = "exhaustion.json"
"""Name of the file with the proof that they do not, if that is the verdict."""
PICTURE: Final = "picture.png"
MANIFEST: Final = "manifest.json"
ATTEMPTS_DIR: Final = "attempts"
PLANS_DIR: Final = "plans"
EARLIER_FILES: Final = ("timeline.zarr", "figures.zarr")
"""Folders of earlier versions, which stored motions and figures in another format."""
FIRST_FOLD_DIR: Final = "start"
"""Name of the subdirectory of a refold's directory in which ``foldback refold`` folds the start
shape, if it is given a shape rather than a folded chain."""
TABLE_FILE: Final = "table.json"
"""Name of the file that ``foldback table`` writes beside a plan."""
TRIALS_DIR: Final = ".foldback-tries"
"""Name of the directory, in a fold's own, with a subdirectory for each attempt that another process
computes in advance."""
PLAYABLE: Final = (CHAIN, TIMELINE, CERTIFICATE)
"""Files that are kept of a verified plan that was not chosen, so that the web page can still play
it."""
RESULT_FILES: Final = (CHAIN, TIMELINE, RECORD, PLAYBACK, CERTIFICATE, FORCES)
"""Names of the files that one attempt of a fold writes into a folder of its own. When the fold is
over, those of the best attempt are moved to the fold's directory."""
EXPORTED_FILES: Final = (PLAN, MODEL)
"""Files that the last stage of a fold, the export, writes from the chosen attempt."""
DERIVED_FILES: Final = (FIGURES, MOMENTS)
"""Files that are computed from those of a finished fold when somebody asks for its figures."""
VERDICT_FILES: Final = (VERDICT, EXHAUSTION)
"""Files that are computed when somebody asks whether turns lead to its figure."""
LATER_FILES: Final = (*DERIVED_FILES, *VERDICT_FILES)
"""All files that are computed from those of a finished fold when somebody asks for them."""
DESCRIBED: Final = (
    *(INPUT, REQUEST, START_CHAIN, START_PLAN, RECORDED_PLAN, CANDIDATES, CHAIN, ATTEMPTS),
    *(RECORD, PLAYBACK, CERTIFICATE, FORCES, TIMELINE),
    *EXPORTED_FILES,
    *LATER_FILES,
)
"""Files of a fold that determine or describe its plan. The fold's manifest lists their SHA-256
digests in this order, so that later changes are noticed."""
FOLD_FILES: Final = (
    *DESCRIBED,
    *EARLIER_FILES,
    *(PLAN_TEXT, PREPARED, PICTURE, MANIFEST, ATTEMPTS_DIR, PLANS_DIR, TRIALS_DIR),
)
"""All files and folders that a fold writes into its directory."""
