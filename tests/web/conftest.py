import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.timeline import TimelineWriter
from foldback.planner.pathfinding.snake import snake_path
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.shape_writers import write_chain
from tests.planner.chains import chain_of
from tests.tools import OPENGL

SNAKE = [(x if y % 2 == 0 else 3 - x, y, 0) for y in range(4) for x in range(4)]
FINAL_ERROR_RAD = 3e-3
Growing = tuple[Path, TimelineWriter, Callable[[int], None]]
"""Type of the fixture ``growing``."""


@pytest.fixture(scope="session")
def chain() -> Chain:
    return chain_of(SNAKE, name="snake")


def unfolding(chain: Chain, count: int) -> Motion:
    """Return a motion from folded to straight in even steps."""
    return _between(chain, "explosion", np.linspace(1.0, 0.0, count), 0.0)


def folding(chain: Chain, count: int) -> Motion:
    """Return a motion from straight to folded; the error of one middle hinge grows linearly."""
    share = np.linspace(0.0, 1.0, count)
    frames = _between(chain, "playback", share, 10.0)
    error = np.zeros_like(frames.joint_angles_rad)
    error[:, 2 * (6 - 1)] = FINAL_ERROR_RAD * share
    return frames.with_columns(joint_error_rad=error)


def _between(chain: Chain, phase: str, share: np.ndarray, start_s: float) -> Motion:
    poses = chain.folded_poses
    count = len(share)
    return Motion.from_frames(
        phase=phase,  # type: ignore[arg-type]
        time_s=start_s + np.arange(count) * 0.1,
        joint_angles_rad=share[:, None] * chain.folded_rad,
        root_position=np.tile(poses.positions[chain.root], (count, 1)),
        root_wxyz=np.tile(poses.wxyzs[chain.root], (count, 1)),
    )


@pytest.fixture(scope="session")
def timeline_path(chain: Chain, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of a complete timeline: 100 frames of explosion, 100 of playback."""
    path = tmp_path_factory.mktemp("timeline") / "timeline"
    with TimelineWriter.create(path, chain) as writer:
        writer.append(unfolding(chain, 100))
        writer.append(folding(chain, 100))
    return path


@pytest.fixture(scope="session")
def peeled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of a box that was peeled and that two robots with model errors folded again."""
    box = json.dumps(snake_path((3, 3, 4)).tolist()).encode()
    return _fold(tmp_path_factory.mktemp("peeled"), box, strategy="peel", settings="robots=2")


@pytest.fixture(scope="session")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of a ring of 12 tetrahedra that simulated robots folded."""
    angles = np.full(11, -np.pi / 2)
    angles[3::4] *= -1.0
    chain = Chain.from_angles(TETRAHEDRON, angles)
    return _fold(tmp_path_factory.mktemp("ring"), write_chain(chain), strategy="simultaneous")


@pytest.fixture(scope="session")
def kinematic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of a box of 8 cubes that was peeled and not simulated."""
    box = json.dumps(snake_path((2, 2, 2)).tolist()).encode()
    directory = tmp_path_factory.mktemp("kinematic")
    return _fold(directory, box, strategy="peel", settings="simulated_modules=2")


def _fold(directory: Path, data: bytes, **options: str) -> Path:
    Workspace(directory).write_request(FoldRequest(**options), data)
    run_stages(directory)
    complete(directory)
    return directory


@pytest.fixture
def growing(chain: Chain, tmp_path: Path) -> Growing:
    """Path of a timeline with ten frames, its writer, and a function that adds more."""
    path = tmp_path / "timeline"
    writer = TimelineWriter.create(path, chain)

    def add(count: int) -> None:
        writer.append(unfolding(chain, count))
        writer.flush()

    add(10)
    return path, writer, add


@pytest.fixture(scope="session")
def backend() -> str:
    """Backend of OpenGL that draws without a screen."""
    return OPENGL.get()
