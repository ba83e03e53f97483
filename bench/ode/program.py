"""Program: the published algorithm on ODE, in C++, built and run."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.parameters.parameters import preset
from foldback.planner.parameters.published import PaperExplosionParameters

SOURCE: Final = Path(__file__).parent / "published.cpp"
FLAGS: Final = ("-std=c++20", "-O2", "-Wall", "-Wextra")
EXPLOSION_VALUES: Final = (
    *("radial_gain", "repulsion_gain", "repulsion_cutoff", "spring", "geom_size", "max_steps"),
    *("pitch_cm", "density_kg_m3", "damping", "friction", "step_s", "snapshot_interval"),
)
"""Parameters of the preset ``paper`` that the program takes as they are."""
PLAYBACK_VALUES: Final = ("motor_gain", "threshold")
"""Parameters of that preset's playback that the program takes as they are."""


class OdeMissingError(Exception):
    """A program or library that the benchmark needs is not installed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solver:
    """Solvers of ODE, and pace of the playback.

    Attributes:
        explosion_iterations, playback_iterations: Iterations of ``dWorldQuickStep``; 0 for the
            direct solver, ``dWorldStep``.
        steps_per_snapshot: Minimum number of playback steps for each snapshot.
    """

    explosion_iterations: int
    playback_iterations: int
    steps_per_snapshot: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OdePhase:
    """Explosion or playback on ODE.

    Attributes:
        status: ``straight`` or ``folded`` if it worked.
        steps: Number of time steps.
        processor_s: Processor time, s.
        joint_gap_cm: Largest distance by which a joint came apart, cm.
        overlap_cm: Depth of the deepest contact, cm.
    """

    status: str
    steps: int
    processor_s: float
    joint_gap_cm: float
    overlap_cm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class OdeRun:
    """Result of the program.

    Attributes:
        explosion, playback: Its two simulations.
        max_angle_error_rad: Largest error of a hinge against its snapshot in the playback, rad.
        snapshots_rad: (S, J) hinge angles of the snapshots.
        frames_rad: (F, J) hinge angles of the playback when it turns to each snapshot, and at its
            end; empty without a playback.
    """

    explosion: OdePhase
    playback: OdePhase
    max_angle_error_rad: float
    snapshots_rad: Array
    frames_rad: Array


def find_compiler(environment: Mapping[str, str] = os.environ) -> str:
    """Return the C++ compiler: ``CXX``, or the first one on the path.

    Raises:
        OdeMissingError: There is none.
    """
    names = (environment.get("CXX") or "c++", "g++", "clang++")
    paths = (shutil.which(name, path=environment.get("PATH")) for name in names)
    compiler = next(filter(None, paths), None)
    if compiler is None:
        raise OdeMissingError(
            f"got no C++ compiler, expected one of {', '.join(names)}; run `apt install g++`."
        )
    return compiler


def ode_flags(environment: Mapping[str, str] = os.environ) -> list[str]:
    """Return the compiler's options for ODE, from ``pkg-config``.

    Raises:
        OdeMissingError: ODE or ``pkg-config`` is not installed.
    """
    try:
        answer = subprocess.run(
            ["pkg-config", "--cflags", "--libs", "ode"],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError) as error:
        raise OdeMissingError(
            "got no library ODE from pkg-config, expected version 0.16 or later; run "
            "`apt install pkg-config libode-dev`."
        ) from error
    return answer.stdout.split()


def build(directory: Path) -> Path:
    """Compile the program into a directory, and return it.

    Raises:
        OdeMissingError: The compiler or ODE is not installed.
    """
    program = directory / "published"
    command = [find_compiler(), *FLAGS, str(SOURCE), "-o", str(program), *ode_flags()]
    subprocess.run(command, check=True)
    return program


def values_of(solver: Solver) -> dict[str, float]:
    """Return the values that the program reads, in the units of ``planner.parameters``."""
    parameters = preset("paper")
    explosion, playback = parameters.explosion, parameters.playback
    assert isinstance(explosion, PaperExplosionParameters)
    return {
        **{name: getattr(explosion, name) for name in EXPLOSION_VALUES},
        **{name: getattr(playback, name) for name in PLAYBACK_VALUES},
        "stop_rad": math.radians(explosion.stop_deg),
        "motor_max_force": playback.motor_max_force or 0.0,
        "playback_size": parameters.module_size,
        **asdict(solver),
    }


def input_text(chain: Chain, solver: Solver) -> str:
    """Return the input of the program: values, then the folded pose of each module."""
    poses = chain.folded_poses
    rows = np.concatenate([poses.positions, poses.rotations.reshape(len(chain), 9)], axis=1)
    lines = [f"{name} {value!r}" for name, value in values_of(solver).items()]
    lines.append(f"modules {len(chain)}")
    lines += [" ".join(repr(number) for number in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def run(program: Path, chain: Chain, solver: Solver, directory: Path) -> OdeRun:
    """Explode and fold a chain of cubes; write the program's files into a directory."""
    files = [directory / name for name in ("input", "snapshots", "frames")]
    files[0].write_text(input_text(chain, solver), encoding="utf-8")
    answer = subprocess.run([program, *files], check=True, stdout=subprocess.PIPE, text=True)
    figures = json.loads(answer.stdout)
    return OdeRun(
        explosion=OdePhase(**figures["explosion"]),
        playback=OdePhase(**figures["playback"]),
        max_angle_error_rad=figures["max_angle_error_rad"],
        snapshots_rad=np.fromfile(files[1]).reshape(-1, len(chain.folded_rad)),
        frames_rad=np.fromfile(files[2]).reshape(-1, len(chain.folded_rad)),
    )
