"""Checks of OpenGL, movie encoder, the compiled core and MuJoCo.

Each runs in its own process, because a faulty library can crash it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Final

from foldback.server.doctor.check_result import CheckResult, ok, problem, warning
from foldback.server.processes.movie_task import GL_SETTING, NO_FFMPEG, NO_GL, backends
from foldback.server.settings import Settings

DRAWING_TIMEOUT_S: Final = 60.0
"""Maximum time of the check of ``foldback doctor`` that OpenGL can draw, in s; then the check has
failed."""
_DRAW: Final = """
import sys, mujoco, importlib
context = importlib.import_module(f"mujoco.{sys.argv[1]}").GLContext(64, 64)
context.make_current()
model = mujoco.MjModel.from_xml_string("<mujoco/>")
mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
"""
_ENCODE: Final = """
import sys
from foldback.web.movies.encoding import NoEncoderError, find_ffmpeg, formats
try:
    print(find_ffmpeg(), "with" if "mp4" in formats() else "without", "x264")
except NoEncoderError as error:
    sys.exit(error)
"""
_LOAD_CORE: Final = """
import numpy as np
from foldback.planner.core import best_overlap
best_overlap(np.ones(8, np.int64), 1.0, 8.0, 1, 8)
print("the compiled core computes")
"""
_SIMULATE: Final = """
import sys
from importlib.metadata import version
import mujoco
loaded, installed = mujoco.mj_versionString(), version("mujoco")
if loaded != installed:
    sys.exit(f"the library has version {loaded}, its package {installed}")
model = mujoco.MjModel.from_xml_string("<mujoco/>")
mujoco.mj_step(model, mujoco.MjData(model))
print(f"MuJoCo {loaded} computes")
"""


def gl(_: Settings) -> CheckResult:
    """Check that an OpenGL backend can draw movies without a screen."""
    backend_names = backends()
    messages: list[str] = []
    for backend in backend_names:
        code, words = run_python(_DRAW, backend, environment={GL_SETTING: backend})
        if code == 0:
            return ok(f"{backend} can draw without a screen")
        messages.append(f"{backend}: {words}")
    return warning(
        "movies cannot be made: "
        f"{'; '.join(messages) or f'drawing is switched off by {GL_SETTING}'}",
        f"{NO_GL[0].upper()}{NO_GL[1:]}." if backend_names else f"Unset {GL_SETTING}.",
    )


def encoder(_: Settings) -> CheckResult:
    """Check that ffmpeg can encode movies as MP4; GIF needs no encoder."""
    code, words = run_python(_ENCODE)
    if code == 0 and words.endswith(" with x264"):
        return ok(words)
    return warning(
        f"movies can only be GIF files: {words}",
        f"Unset IMAGEIO_FFMPEG_EXE if it is set. {NO_FFMPEG}.",
    )


def core(_: Settings) -> CheckResult:
    """Check that the compiled core suits this processor."""
    code, words = run_python(_LOAD_CORE)
    if code == 0:
        return ok(words)
    return problem(
        f"the compiled core cannot be used ({words})",
        "Install foldback with `--config-settings=cmake.define.FOLDBACK_BASELINE=ON`, which builds "
        "a core for any processor.",
    )


def mujoco(_: Settings) -> CheckResult:
    """Check that MuJoCo's library is the one of its package, also after an upgrade in place."""
    code, words = run_python(_SIMULATE)
    if code == 0:
        return ok(words)
    return problem(
        f"MuJoCo cannot be used ({words})",
        "Run `pip install --force-reinstall mujoco` with the version that foldback requires.",
    )


def run_python(
    code: str, *arguments: str, environment: dict[str, str] | None = None
) -> tuple[int, str]:
    """Run Python code in a new process; return the exit code and the last line of output."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code, *arguments],
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=DRAWING_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1, f"no answer within {DRAWING_TIMEOUT_S:.0f} s"
    if done.returncode < 0:
        return done.returncode, f"it crashed (signal {-done.returncode})"
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    return done.returncode, lines[-1][:200] if lines else f"exit code {done.returncode}"
