from dataclasses import fields, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.figures_store import CLEARANCE_REACH_PITCH, Curves, Figures
from foldback.planner.certificate.frame_figures import clearances_of, write_figures
from foldback.planner.certificate.plan_figures import torque_unit_nm
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import floating_torques, spline_derivatives
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.sweep import pair_clearance, sweep
from foldback.planner.errors import TimelineError
from foldback.planner.motion.motion import Phase
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.derived_files import complete
from tests.planner.chains import Array, anchored, coil, random_angles

PARAMETERS = Parameters()


def timeline_of(path: FilePath, chain: Chain, *parts: tuple[Phase, Array], error: float) -> None:
    """Return a timeline of the given phases, one frame per second, every joint error the same."""
    start = 0
    with TimelineWriter.create(path, chain) as writer:
        for phase, angles in parts:
            count = len(angles)
            time_s = np.arange(start, start + count, dtype=np.float64)
            error_rad = np.full_like(angles, error)
            writer.append(anchored(phase, angles, time_s=time_s, error_rad=error_rad))
            start += count - 1


def figures_of(
    timeline: FilePath, parameters: Parameters, certificate: Certificate | None = None
) -> Figures:
    path = timeline.with_name("computed")
    write_figures(timeline, path, parameters, certificate=certificate)
    return Figures.load(path)


def by_brute_force(chain: Chain, angles: Array, size: float) -> tuple[Array, NDArray[np.int64]]:
    module = chain.module
    poses = forward_kinematics(module, angles)
    n = len(chain)
    sampled_clearance = np.full((n, n), np.inf)
    for i in range(n):
        for j in range(i + module.apart, n):
            sampled_clearance[i, j] = sampled_clearance[j, i] = pair_clearance(
                module, poses, (i, j), module_size=size
            )
    return sampled_clearance.min(axis=1), sampled_clearance.argmin(axis=1)


@pytest.mark.parametrize("size", [0.95, 1.1])
@pytest.mark.parametrize("chain", [coil(14), Chain.from_angles(TETRAHEDRON, np.zeros(13))], ids=len)
def test_clearances_are_those_of_all_pairs(chain: Chain, size: float) -> None:
    rng = np.random.default_rng(11)
    angles = np.stack(
        [random_angles(chain, rng, max_angle) for max_angle in (0.0, 0.4, 0.8, 1.2, 1.5, 1.6)]
    )
    clearance, nearest = clearances_of(chain, angles, module_size=size)
    assert clearance.min() < 0.0 or size < 1.0
    for k in range(len(angles)):
        least_distance, nearest_module = by_brute_force(chain, angles[k], size)
        np.testing.assert_allclose(
            clearance[k], np.minimum(least_distance, CLEARANCE_REACH_PITCH), atol=1e-6
        )
        near = nearest[k] >= 0
        np.testing.assert_array_equal(near, least_distance < CLEARANCE_REACH_PITCH)
        # Either of two equally close pairs may be reported.
        nearest_modules = np.where(near, nearest[k], nearest_module)
        for i in np.flatnonzero(nearest_modules != nearest_module):
            assert clearance[k, nearest_modules[i]] <= clearance[k, i] + 1e-6


@pytest.mark.slow
def test_figures_agree_with_the_certificate(folded: Any, tmp_path: FilePath) -> None:
    figures = Figures.load(folded.directory / "figures")
    frames = Timeline.open(folded.directory / "timeline").frames()
    assert len(figures) == len(frames)
    exploded, played = (frames.phase == phase for phase in (0, 1))
    for part in (exploded, played):
        angles = frames.joint_angles_rad[part]
        frame_clearance = sweep(folded.chain, angles, module_size=PARAMETERS.module_size).per_frame
        capped = np.minimum(figures.min_clearance[part], 0.2)
        np.testing.assert_allclose(capped, np.minimum(frame_clearance, 0.2), atol=1e-6)
    certificate: Certificate = folded.plan.certificate
    least_clearance = figures.min_clearance[played].min()
    assert least_clearance >= certificate.min_clearance_playback - 1e-6
    for values in (figures.max_error_rad, figures.torque_nm):
        assert np.isnan(values[exploded]).all()
    largest = frames.joint_error_rad[played].max()
    assert figures.max_error_rad[played].max() == pytest.approx(largest)
    torques = np.abs(figures.torque_nm[played])
    np.testing.assert_array_equal(figures.peak_torque_nm[played], torques.max(axis=1))
    # The certificate checks every step and the figures only frames: they agree closely.
    assert torques.max() == pytest.approx(certificate.peak_torque_nm, rel=0.35)
    most_hinges = certificate.hinges_moving_most
    assert figures.hinges_moving[played].max() == pytest.approx(most_hinges, abs=2)
    # Torques are computed at the certificate's fold time.
    slow = replace(certificate, fold_time_s=2.0 * certificate.fold_time_s)
    for name in ("request.json", "timeline"):
        (tmp_path / name).symlink_to(folded.directory / name)
    slower = figures_of(tmp_path / "timeline", PARAMETERS, slow)
    np.testing.assert_allclose(slower.torque_nm, 0.25 * figures.torque_nm, rtol=1e-5)
    # Without a certificate the speed is that of the frames, not of the plan.
    complete(tmp_path)
    alone = Curves.load(tmp_path / "figures")
    np.testing.assert_array_equal(alone.min_clearance, figures.min_clearance)
    np.testing.assert_allclose(alone.peak_torque_nm, figures.peak_torque_nm, rtol=0.02)


def test_figures_of_several_chunks_are_computed_and_read_in_any_range(tmp_path: FilePath) -> None:
    # 300 frames are three chunks, and the playback begins within the first.
    chain = coil(8)
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 260))  # at rest at both ends
    angles = share[:, None] * chain.folded_rad
    exploded = angles[::-1][220:]
    timeline_of(tmp_path / "t", chain, ("explosion", exploded), ("playback", angles), error=0.1)
    figures = figures_of(tmp_path / "t", PARAMETERS)
    frames = Timeline.open(tmp_path / "t").frames()
    times = frames.time_s[frames.phase == 1]
    rates, accelerations = spline_derivatives(times, angles, np.arange(len(angles)), from_rest=True)
    expected = floating_torques(chain.module, angles, rates, accelerations)
    fastest = np.abs(np.diff(angles, axis=0)).max()
    expected *= torque_unit_nm(chain, PARAMETERS) / fastest**2
    torques_nm = figures.torque_nm[frames.phase == 1]
    np.testing.assert_allclose(torques_nm, expected, atol=1e-6 * np.abs(expected).max())
    assert (figures.hinges_moving == np.count_nonzero(chain.folded_rad)).all()
    assert (figures.max_error_rad == np.float32(0.1)).all()
    least_clearance = sweep(chain, angles, module_size=PARAMETERS.module_size).per_frame.min()
    assert (
        figures.min_clearance.min() == pytest.approx(least_clearance, abs=1e-6)
        and least_clearance < 0.0
    )
    path = tmp_path / "computed"
    write_figures(tmp_path / "t", path, PARAMETERS)  # replaces the stored figures
    for start, stop in ((0, 300), (100, 140), (299, 300), (7, 7)):
        part = Figures.load(path, start, stop)
        for field in fields(Figures):
            values = getattr(figures, field.name)[start:stop]
            np.testing.assert_array_equal(getattr(part, field.name), values)
            assert getattr(part, field.name).dtype == values.dtype
    np.testing.assert_array_equal(Curves.load(path).min_clearance, figures.min_clearance)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["computed", "t"]
    with pytest.raises(TimelineError, match="no readable figures at"):
        Figures.load(tmp_path / "nothing")
    for start, stop in ((-1, 3), (5, 4), (0, 301)):
        with pytest.raises(TimelineError, match="300 frames"):
            Figures.load(path, start, stop)
