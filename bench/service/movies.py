"""Movies: time and size of the movies and pictures of a fold, with software OpenGL."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.sections import Section
from foldback.planner.motion.timeline import Timeline
from tests.tools import OPENGL

SHAPE = "wrench-160"
"""Shape of the gallery that is folded and filmed."""
MAX_MOVIE_S = 60.0
"""Target of the benchmark: the command that draws and writes a movie of a fold takes less wall time
than this, in s. At or above it the target is reported as not met."""
MAX_PICTURE_S = 1.0
"""Target of the benchmark: drawing the preview picture of a fold for social networks takes less
wall time than this, in s. At or above it the target is reported as not met."""
OPTIONS: dict[str, list[str]] = {
    "fold.mp4": ["--width", "1280", "--height", "720", "--fps", "30", "--seconds", "10"],
    "fold.gif": [],
}
"""Options of the command line by file name of the movie."""


def movies(reference_seconds: float) -> Section:
    """Fold the 160 wrench; write an MP4 of 720p, a plain GIF and the social picture."""
    del reference_seconds
    section = Section(name="movies")
    backend = OPENGL.get()
    command = [sys.executable, "-m", "foldback.server.cli.command_line"]
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        directory = Path(folder) / "fold"
        subprocess.run([*command, "fold", SHAPE, "--out", str(directory)], check=True)
        for name, words in OPTIONS.items():
            out = Path(folder) / name
            film = [*command, "movie", str(directory), "--out", str(out), "--json", *words]
            start_s = time.perf_counter()
            done = subprocess.run(film, check=True, stdout=subprocess.PIPE)
            seconds = time.perf_counter() - start_s
            about = json.loads(done.stdout)
            label = f"{SHAPE} as {about['format'].upper()}"
            size = f"{about['width']}×{about['height']}, {about['pictures']} pictures, {backend}"
            judged = {"bar": f"< {MAX_MOVIE_S:.0f} s", "met": seconds < MAX_MOVIE_S}
            section.add(f"{label}, {size}, all in all", f"{seconds:.1f} s", **judged)
            section.add(f"{label}, per picture", f"{1e3 * seconds / about['pictures']:.0f} ms")
            section.add(f"{label}, file", f"{out.stat().st_size / 1e6:.2f} MB")
        _picture(section, directory)
    return section


def _picture(section: Section, directory: Path) -> None:
    from foldback.web.pictures.social_picture import social_picture

    chain = Timeline.open(directory / "timeline").chain
    social_picture(chain)  # compile and load modules first
    start_s = time.perf_counter()
    data = social_picture(chain)
    seconds = time.perf_counter() - start_s
    section.add(
        f"{SHAPE} as social picture, a PNG file of {len(data) / 1e3:.0f} kB",
        f"{seconds:.2f} s",
        f"< {MAX_PICTURE_S:.0f} s",
        seconds < MAX_PICTURE_S,
    )
