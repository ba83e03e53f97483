"""Standalone: pages that play without a server, also from a local disk.

A downloaded page holds a whole fold: the same scripts as the embedded one, viser's client, the
scene bundle and a single batch of all frames. The pages of a static website share scripts and
client instead. An import map of data URLs names the scripts, which are not bundled. The map is
compressed; ``js/unpack.js`` unpacks it and then imports the page's entry script. Only the checker
is bundled into one script: it is a worker, and import maps do not apply to workers.

For the checker, the page also holds the part of the plan that its claim covers. If the timeline is
a windowed plan backwards and then forwards, the angles of the frames are taken from the plan.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np

from foldback.planner.motion.angle_encoding import plan_columns
from foldback.planner.motion.motion import Motion
from foldback.planner.plan.claim import claimed_part
from foldback.web.pictures.table_top import TableTop
from foldback.web.static_files import SCRIPT_IMPORT, STATIC, code_of, imported, scripts_of, text_of
from foldback.web.timeline.frame_batch import UNLIMITED_BYTES, batch_of, thinned, unpacked_bytes
from foldback.web.timeline.view import TimelineView
from foldback.web.viser.client import client
from foldback.web.viser.scene_bundle import bundle_of

ENTRY_SCRIPT: Final = "js/pages/standalone.js"
FILMS_SCRIPT: Final = "js/pages/static_paper.js"
"""Entry script of the page of the paper's experiments in a static website."""
KIOSK_SCRIPT: Final = "js/pages/kiosk.js"
"""Entry script of the kiosk in a static website."""
UNPACK_SCRIPT: Final = "js/unpack.js"
WORKER_SCRIPT: Final = "js/viewer/sketch_worker.js"
CHECKER_SCRIPT: Final = "js/check/worker.js"
CHECKER_NAME: Final = "foldback/checker"
"""Name of the bundled checker in the import map; some of its scripts are in the map as well."""
THEME_SCRIPT: Final = "js/theme.js"
STYLES: Final = ("css/base.css", "css/fold.css", "css/tour.css")
UNESCAPED_CHARACTERS: Final = " !$&'()*+,-./:;=?@[]^_`{|}~"
"""Characters, besides letters and digits, that stay unescaped in the data URLs of a single HTML
file with a fold."""
MAX_STANDALONE_BYTES: Final = 48 * 2**20
"""Maximum size of the frames in a single HTML file with a fold, in bytes before compression. Of
larger motions frames are left out, and so are the plots and the plan."""
WINDOW_ANGLES: Final = frozenset({"first", "counts", "steps"})
"""Columns of a batch of windows that a page can take from the plan."""
MODULE_WORDS: Final = re.compile(r"^import [^;]*;\n|^export ", re.MULTILINE)
"""Matches the module syntax of a script: imports, and the word ``export``."""

Render = Callable[..., str]


def standalone_html(
    timeline: TimelineView,
    render: Render,
    facts: Mapping[str, Any],
    *,
    plan: Path | None = None,
    curves: bytes | None = None,
    forces: bytes | None = None,
    table: TableTop | None = None,
    view: str | None = None,
    stored_parts: Mapping[str, Any],
) -> bytes:
    """Return the page of one finished fold.

    Args:
        timeline: The fold's frames.
        render: Fills the template ``standalone.html`` with the given values.
        facts: Facts of the fold, as for its own page.
        plan: The verified plan's ``.npz`` file, for the checker; None if there is nothing to check.
        curves: Data of the plots, from ``web.timeline.figures``.
        forces: Result of ``web.timeline.figures.table_forces``, for a fold on a table.
        table: Table under the chain; None if it floats.
        view: Address of viser's client, for pages that share it; None to put it into the page.
        stored_parts: ``tour``, ``values`` and ``steps`` of the fold, each None if there are none.

    Raises:
        TimelineError: If the timeline is being replaced.
    """
    stride = max(1, -(-unpacked_bytes(timeline) // MAX_STANDALONE_BYTES))
    if stride > 1:
        plan, batch = None, thinned(timeline, stride)
    else:
        repeated_columns = WINDOW_ANGLES if plan and _repeats(timeline, plan) else frozenset[str]()
        batch = batch_of(timeline, largest=UNLIMITED_BYTES, without=repeated_columns)
    parts = {
        "client": client().html.decode() if view is None else None,
        "view": view,
        "bundle": _text(bundle_of(timeline.chain, timeline.stretch, table)),
        "batch": _text(batch),
        "plan": None if plan is None else _text(claimed_part(plan)),
        "curves": None if curves is None or stride > 1 else _text(curves),
        "forces": None if forces is None or stride > 1 else _text(forces),
        "tightest": facts.get("tightest") if stride == 1 else None,
        **stored_parts,
    }
    styles = "".join(text_of(name) for name in STYLES)
    return render(
        styles=styles,
        theme=code_of(THEME_SCRIPT),
        scripts=packed_scripts(ENTRY_SCRIPT),
        entry=entry_of(ENTRY_SCRIPT),
        parts=_script_json(parts),
        facts=facts,
    ).encode()


def _repeats(timeline: TimelineView, plan: Path) -> bool:
    """Return True if a timeline holds the angles of a windowed plan backwards, then forwards."""
    if not timeline.windowed:
        return False
    motion = Motion.from_angles(**plan_columns(plan, timeline.chain.folded_rad))
    there_and_back, shown_motion = (
        Motion.joined((motion[::-1], motion)),
        timeline.motion(0, len(timeline)),
    )
    return all(
        np.array_equal(getattr(there_and_back, name), getattr(shown_motion, name))
        for name in ("first", "offsets", "angles_rad")
    )


@cache
def standalone_scripts() -> str:
    """Return a version that changes with the page's scripts and styles: letters and digits."""
    digest = hashlib.sha256(client().html + packed_scripts(ENTRY_SCRIPT).encode())
    for name in (THEME_SCRIPT, *STYLES):
        digest.update((STATIC / name).read_bytes())
    return digest.hexdigest()


def entry_of(name: str) -> str:
    """Return the name of a script in the import map."""
    return f"foldback/{name}"


@cache
def packed_scripts(*entries: str) -> str:
    """Return a script that holds all scripts of pages and imports the entry that its tag names.

    It contains a compressed import map from the names of the scripts to data URLs with their code.
    """
    names = dict.fromkeys(name for entry in entries for name in scripts_of(entry))
    imports = {entry_of(name): _address_of(name) for name in names}
    imports[CHECKER_NAME] = _address(_checker())
    packed = zlib.compress(json.dumps({"imports": imports}).encode(), 9)
    parts = {"imports": _text(packed), "worker": code_of(WORKER_SCRIPT)}
    return f"window.foldbackScripts = {_script_json(parts)};\n{code_of(UNPACK_SCRIPT)}"


def _checker() -> str:
    """Return the checker as one script without modules; imported scripts come first."""
    names = reversed(scripts_of(CHECKER_SCRIPT))
    return "".join(MODULE_WORDS.sub("", code_of(name)) for name in names)


def _address_of(name: str) -> str:
    """Return a script as a data URL that imports other scripts by name."""

    def named(match: re.Match[str]) -> str:
        return f'{match[1]}"{entry_of(imported(name, match[2]))}"'

    return _address(SCRIPT_IMPORT.sub(named, code_of(name)))


def _address(code: str) -> str:
    """Return a script as a data URL; percent-encoding it is shorter than base64."""
    return f"data:text/javascript,{quote(code, safe=UNESCAPED_CHARACTERS)}"


def film_script(name: str, **parts: bytes) -> str:
    """Return a script that holds a film, for pages that must not fetch anything.

    Args:
        name: Address of the film, as the page names it.
        parts: Scene bundle and batch of the film.
    """
    film = _script_json({part: _text(data) for part, data in parts.items()})
    return f"(window.foldbackFilms ??= {{}})[{json.dumps(name)}] = {film};\n"


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _script_json(value: Any) -> str:
    """Return JSON that is safe inside a script element."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
