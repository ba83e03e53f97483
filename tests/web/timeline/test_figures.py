import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from foldback.planner.certificate.figures_store import Figures
from foldback.planner.certificate.frame_figures import write_figures
from foldback.planner.errors import TimelineError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.web.timeline.figures import curves_of, stretch_of
from tests.planner import peels
from tests.web import long_folds
from tests.web.conftest import SNAKE
from tests.web.timeline.decoding import decode


@pytest.fixture(scope="module")
def fold(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("fold")
    Workspace(directory).write_request(FoldRequest(), json.dumps(SNAKE).encode())
    run_stages(directory)
    complete(directory)
    return directory


def test_curves_and_stretches_are_those_of_the_figures(fold: Path) -> None:
    header, arrays = decode(curves_of(fold, fold))
    figures = Figures.load(fold / "figures")
    assert header["frames"] == len(figures)
    assert header["torque_at_some_frames"] is False
    assert np.allclose(arrays["min_clearance"], figures.min_clearance)
    assert header["largest"]["torque"] == pytest.approx(np.nanmax(figures.peak_torque_nm))
    for name, figure_values in (("clearance", figures.clearance), ("nearest", figures.nearest)):
        assert np.array_equal(join_up(fold, name), figure_values)


def join_up(fold: Path, name: str) -> np.ndarray:
    """Return a figure of every module, concatenated from all stretches."""
    header, _ = decode(curves_of(fold, fold))
    parts = range(-(-header["frames"] // header["rows"]))
    return np.concatenate([decode(stretch_of(fold, fold, k))[1][name] for k in parts])


@pytest.mark.parametrize("kind", ["fold", "peeled"])
def test_position_errors_are_those_of_the_joint_errors(
    kind: str, request: pytest.FixtureRequest
) -> None:
    fold: Path = request.getfixturevalue(kind)
    plan = Plan.load(fold / "plan.npz")
    timeline = Timeline.open(fold / "timeline")
    first = len(timeline) - len(plan.time_s)
    errors = join_up(fold, "position_error")
    assert np.isnan(errors[:first]).all()
    frame = int(np.nanargmax(np.nanmax(errors[first:], axis=1)))
    played = timeline.frames(first + frame, first + frame + 1)
    root = (played.root_position, played.root_wxyz)
    position = plan.chain.poses(played.joint_angles_rad, *root).positions[0]
    meant = plan.chain.poses(plan.joint_angles_rad[frame : frame + 1], *root).positions[0]
    assert np.allclose(errors[first + frame], np.linalg.norm(position - meant, axis=1), atol=1e-6)
    assert errors[first + frame][plan.chain.root] == 0.0
    assert np.nanmax(errors) > 0.0
    largest = decode(curves_of(fold, fold))[0]["largest"]["position_error"]
    assert 0.3 * np.nanmax(errors) < largest <= np.nanmax(errors) * (1 + 1e-6)


def test_peeled_chain_has_errors_alone(peeled: Path) -> None:
    header, arrays = decode(curves_of(peeled, peeled))
    played = np.isfinite(arrays["max_error_rad"])
    assert 0 < played.sum() < len(played)
    assert arrays["max_error_rad"][played].max() > 1e-5
    widths = decode(stretch_of(peeled, peeled, 0))[0]["widths"]
    assert widths == {"position_error": len(Timeline.open(peeled / "timeline").chain)}
    with pytest.raises(TimelineError):
        stretch_of(peeled, peeled, header["frames"])


def test_windows_without_simulation_have_torques_of_some_frames_and_no_stretch(
    tmp_path: Path, fold: Path
) -> None:
    chain = peels.snake((2, 2, 3))
    windows = long_folds.fold(chain, width=8, step=0.5)
    timeline = long_folds.write(tmp_path / "timeline", chain, windows)
    write_figures(timeline, tmp_path / "figures", Parameters())
    assert decode(curves_of(tmp_path, tmp_path))[0]["torque_at_some_frames"] is True
    for place, stretch in ((tmp_path, 0), (fold, 10_000)):
        with pytest.raises(TimelineError):
            stretch_of(place, place, stretch)


def test_plan_is_read_once_for_all_stretches(
    fold: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = Path(shutil.copytree(fold, tmp_path / "fold"))
    loaded: list[object] = []
    load = np.load

    def counting(path: object, **words: object) -> object:
        loaded.append(path)
        return load(path, **words)  # type: ignore[arg-type]

    monkeypatch.setattr(np, "load", counting)
    first = stretch_of(copy, copy, 0)
    assert stretch_of(copy, copy, 0) == first
    assert len(loaded) == 1
    plan = copy / "plan.npz"
    plan.rename(tmp_path / "before.npz")
    shutil.copy(tmp_path / "before.npz", plan)  # computed again
    assert stretch_of(copy, copy, 0) == first
    assert len(loaded) == 2
