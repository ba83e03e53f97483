"""Playback: folding the straight chain by servoing through the reversed record."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import FRAMES_AT_ONCE
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import DEFAULT_MODULE_SIZE
from foldback.planner.errors import InputError
from foldback.planner.motion.angle_encoding import packed_frames, plan_columns, unpacked_frames
from foldback.planner.motion.inverse_dynamics import inverse_dynamics
from foldback.planner.motion.motion import Angles, Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.playback.chain_run import PlaybackStatus
from foldback.planner.playback.kinematic_playback import kinematic_frames, rests_between_places
from foldback.planner.playback.reference_curve import resting_reference
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.robot_runs import simulate_robots
from foldback.planner.playback.simulation_work import simulates
from foldback.planner.playback.unfolding import Unfolding
from foldback.planner.playback.window_run import WindowRun
from foldback.planner.playback.window_trajectory import FRAME_RAD, WindowTrajectory
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.reasons import Reason
from foldback.planner.storage.array_files import save_npz
from foldback.planner.storage.file_names import PLAN, TIMELINE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Playback:
    """The outcome of a playback: simulated, or the reference itself.

    Attributes:
        status: ``folded`` if the chain reached its shape, else the kind of failure.
        reason: Reason why it is not folded; None if it is.
        frames: Simulated configurations with their joint errors: from straight on or, of a
            refold, from where it begins on, over straight.
        reference_rad: (F, J) planned hinge angles at those frames, rad; of windows (V,), as their
            angles; None if the frames are the plan itself.
        steps: Number of simulation steps.
        seconds: Wall time, s.
        rms_position_error: RMS error of the modules' centres at the end, pitches, after
            alignment; None if it was not simulated.
        max_angle_error_rad: Largest joint error over all steps; None if it was not simulated.
        peak_torque: Largest computed hinge torque, in units of module mass · pitch² / s².
        rms_torque: Root mean square over time of the largest hinge torque.
        kind: ``dynamic`` when it was simulated; ``kinematic`` when the reference itself was taken,
            for chains too long for the single tree. Joint errors are then NaN, torques those of
            inverse dynamics at frames spread over the motion.
        torque_frames: Number of those frames; None if torques are those of every step.
        robots: Number of robots with model errors that folded it, of which this is the one with
            the largest error; None for an ideal one, and if nothing was simulated.
        rest_frames: Frames at which the chain rests: before, between and after its turns. From each
            to the next, all hinges turn evenly. None if it does not rest.
        others_rad: (robots − 1, F, J) hinge angles of the others at the same frames, of windows
            (robots − 1, V); None if there are none.
        mujoco_rad: (F, J) hinge angles, at the same frames, of a robot that MuJoCo itself
            simulated; None if there is none.
        mujoco_robot: Index of the robot with the same model errors, 0 for the one that is shown;
            None if there is none.
    """

    status: PlaybackStatus
    reason: Reason | None
    frames: Motion
    reference_rad: Angles | None
    steps: int
    seconds: float
    rms_position_error: float | None
    max_angle_error_rad: float | None
    peak_torque: float | None
    rms_torque: float | None
    kind: Literal["dynamic", "kinematic"] = "dynamic"
    torque_frames: int | None = None
    robots: int | None = None
    others_rad: Angles | None = None
    mujoco_rad: Angles | None = None
    mujoco_robot: int | None = None
    rest_frames: tuple[int, ...] | None = None

    @property
    def simulated(self) -> bool:
        """True if a simulation made its frames."""
        return self.kind == "dynamic"

    @property
    def reference(self) -> Motion:
        """Planned motion: the frames with the angles of the reference, without errors."""
        if self.reference_rad is None:
            return self.frames
        return self.frames.with_angles(np.asarray(self.reference_rad, self.frames.angles_rad.dtype))

    def summary(self) -> dict[str, Any]:
        """Return the figures without the frames."""
        rests = {} if self.rest_frames is None else {"rest_frames": list(self.rest_frames)}
        figures = {name: getattr(self, name) for name in ("status", *_SCALARS)}
        return figures | {"reason": self.reason and self.reason.as_dict()} | rests

    def save(
        self,
        path: FilePath,
        *,
        frames: bool = True,
        reference: bool = True,
        durable: bool = False,
    ) -> None:
        """Write an ``.npz`` that is either complete or absent.

        Args:
            path: Path of the file.
            frames: False if the timeline beside it holds the frames.
            reference: False if the plan beside it holds the reference.
            durable: Flush the file to the disk, so that it survives a power cut.
        """
        columns = self.frames.columns() if frames else {}
        save_npz(
            path,
            {
                "status": np.array(self.status),
                "reason": np.array("" if self.reason is None else self.reason.as_text()),
                **{name: _stored(getattr(self, name)) for name in _SCALARS},
                **(self._reference_columns() if reference else {}),
                **({} if self.others_rad is None else {"others_rad": self.others_rad}),
                **self._mujoco_columns(),
                **({} if self.rest_frames is None else {"rest_frames": self.rest_frames}),
                **columns,
            },
            durable=durable,
        )

    def _reference_columns(self) -> dict[str, Any]:
        """Return the columns of the reference; none if the frames are the reference."""
        if self.reference_rad is None:
            return {}
        if not self.simulated and np.array_equal(self.reference_rad, self.frames.stored_angles_rad):
            return {}
        if self.frames.is_windowed:
            return {"window_reference_rad": self.reference_rad}
        return packed_frames("reference_rad", np.asarray(self.reference_rad, dtype=np.float64))

    def _mujoco_columns(self) -> dict[str, Any]:
        if self.mujoco_rad is None:
            return {}
        return {"mujoco_rad": self.mujoco_rad, "mujoco_robot": np.array(self.mujoco_robot)}

    @classmethod
    def load(cls, path: FilePath, timeline: FilePath | None = None) -> Playback:
        """Read a file that ``save`` wrote.

        Args:
            path: Path of the file.
            timeline: Path of the timeline; the one beside it if None.
        """
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = dict(file)
            if "time_s" in arrays:
                frames = Motion.from_columns(arrays)
            else:
                frames = Timeline.open(timeline or path.with_name(TIMELINE)).playback()
            return cls(
                frames=frames,
                reference_rad=_reference(arrays, frames, path),
                others_rad=arrays.get("others_rad"),
                mujoco_rad=arrays.get("mujoco_rad"),
                mujoco_robot=(
                    int(arrays["mujoco_robot"].item()) if "mujoco_robot" in arrays else None
                ),
                rest_frames=tuple(rests.tolist())
                if (rests := arrays.get("rest_frames")) is not None
                else None,
                status=arrays["status"].item(),
                reason=Reason.from_text(arrays["reason"].item()),
                **{name: _loaded(arrays[name].item()) for name in _SCALARS},
            )


def _reference(arrays: dict[str, Any], frames: Motion, path: FilePath) -> Angles | None:
    """Return the reference in the arrays of a file at ``path``, or in the plan beside it."""
    if "window_reference_rad" in arrays:
        return arrays["window_reference_rad"]
    if any(name.startswith("reference_rad") for name in arrays):
        return unpacked_frames(arrays, "reference_rad")
    if arrays["kind"].item() == "kinematic":
        return None if frames.is_windowed else frames.joint_angles_rad
    chain = Timeline.open(path.with_name(TIMELINE)).chain
    return plan_columns(path.with_name(PLAN), chain.folded_rad)["angles_rad"]


def _stored(value: Any) -> NDArray[Any]:
    """Return a figure as an array, NaN for None."""
    return np.array(np.nan if value is None else value)


def _loaded(value: Any) -> Any:
    return None if isinstance(value, float) and np.isnan(value) else value


_SCALARS: Final = (
    "steps",
    "seconds",
    "rms_position_error",
    "max_angle_error_rad",
    "peak_torque",
    "rms_torque",
    "kind",
    "torque_frames",
    "robots",
)


def play_back(
    chain: Chain,
    record: Record | None,
    parameters: PlaybackParameters,
    *,
    module_size: float = DEFAULT_MODULE_SIZE,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
    start_s: float = 0.0,
    finer: int = 1,
    patience: int = 0,
    unfolding: Unfolding | None = None,
    seed: int = 0,
) -> Playback:
    """Fold the straight chain in simulation: no gravity, the chain floats.

    A refold is one simulation: the chain begins folded otherwise, unfolds, and goes on from there.
    Each of several robots folds it once; the playback is that of the one with the largest error,
    and the sink receives its frames when all have folded. The first one folds it once more in
    MuJoCo itself, where that takes less than a second of the processor.

    Args:
        chain: The chain.
        record: The explosion to play in reverse; the ``direct`` controller needs none.
        parameters: Controller and reference.
        module_size: Size of the colliding modules as a fraction of the pitch.
        sink: Receives the frames as they are made.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.
        start_s: Time of the first frame, s.
        finer: Factor of the number of frames to keep.
        patience: Level of slowness near straight of simulated robots; 0 for none.
        unfolding: Motion by which the chain becomes straight first; None if it is straight.
        seed: Seed of the robots' model errors.

    Raises:
        InputError: An unknown controller, or a controller that needs a record without one.
    """
    began_s = time.perf_counter()
    recorded = None if record is None else record.frames
    windowed = recorded is not None and recorded.is_windowed
    if windowed and unfolding is not None:
        raise InputError(
            "cannot-refold",
            "the strategy 'peel' cannot refold a chain from another shape; fold a straight chain, "
            "or use another strategy.",
        )
    if recorded is not None and not simulates(
        len(chain), len(recorded), parameters, is_windowed=windowed
    ):
        return _followed(chain, record, parameters, module_size, sink, start_s, finer, unfolding)
    if recorded is not None and windowed:
        trajectory = WindowTrajectory(chain, recorded, parameters, module_size, finer, start_s)
    else:
        trajectory = ReferenceTrajectory(
            chain, record, parameters, module_size, start_s, finer, unfolding, patience
        )
    streamed = not windowed and trajectory.robots == 1
    runs, by_mujoco = simulate_robots(
        trajectory, seed, sink if streamed else None, progress, cancelled
    )
    all_runs = runs if by_mujoco is None else [*runs, by_mujoco]
    failed = next((robot_run for robot_run in all_runs if robot_run.status != "folded"), None)
    run = failed or max(runs, key=lambda robot_run: robot_run.largest_error)
    other_angles = [
        robot_run.frames.stored_angles_rad for robot_run in runs if robot_run is not run
    ]
    frames, largest_error = run.frames, run.largest_error
    rest_frames = None if isinstance(run, WindowRun) else tuple(run.rest_frames) or None
    if windowed:  # in single precision, frames may tell a little more
        largest_error = max(largest_error, float(frames.largest_errors.max()))
    if sink is not None and not streamed:
        for start in range(0, len(frames), FRAMES_AT_ONCE):
            sink(frames[start : start + FRAMES_AT_ONCE])
    return Playback(
        status=run.status,
        reason=run.reason,
        frames=frames,
        reference_rad=run.reference_rad,
        steps=run.steps,
        seconds=time.perf_counter() - began_s,
        rms_position_error=run.final_error(),
        max_angle_error_rad=largest_error,
        peak_torque=max(robot_run.peak_torque for robot_run in runs),
        rms_torque=float(np.sqrt(run.square_torque / max(1, run.steps))),
        robots=len(runs) if len(runs) > 1 else None,
        others_rad=np.array(other_angles) if other_angles and failed is None else None,
        mujoco_rad=None if by_mujoco is None or failed else by_mujoco.frames.joint_angles_rad,
        mujoco_robot=None if by_mujoco is None or failed else int(run is not runs[0]),
        rest_frames=rest_frames,
    )


def _followed(
    chain: Chain,
    record: Record | None,
    parameters: PlaybackParameters,
    module_size: float,
    sink: Callable[[Motion], None] | None,
    start_s: float,
    finer: int,
    unfolding: Unfolding | None,
) -> Playback:
    """Play a record back kinematically."""
    assert record is not None
    began_s, recorded = time.perf_counter(), record.frames
    parts: list[Motion] = []
    for frames in kinematic_frames(
        chain,
        recorded,
        parameters,
        module_size=module_size,
        start_s=start_s,
        frame_rad=FRAME_RAD / finer,
        unfolding=unfolding,
        rests=record.rest_frames,
    ):
        parts.append(frames)
        if sink is not None:
            sink(frames)
    frames = Motion.joined(parts)
    torques = inverse_dynamics(chain, frames)
    return Playback(
        status="folded",
        reason=None,
        frames=frames,
        reference_rad=None if frames.is_windowed else frames.joint_angles_rad,
        steps=0,
        seconds=time.perf_counter() - began_s,
        rms_position_error=None,
        max_angle_error_rad=None,
        peak_torque=torques.peak if len(torques.frames) else None,
        rms_torque=torques.rms if len(torques.frames) else None,
        kind="kinematic",
        torque_frames=len(torques.frames),
        rest_frames=_rests_followed(record, unfolding, FRAME_RAD / finer),
    )


def _rests_followed(
    record: Record, unfolding: Unfolding | None, frame_rad: float
) -> tuple[int, ...] | None:
    """Return the frames at rest of a kinematic playback; None if the chain does not rest."""
    before, rests = 0, list[int]()
    if unfolding is not None:
        before = len(unfolding.folding_rad) - 1
        rests = [before - k for k in unfolding.rest_frames[::-1]]
    if record.rest_frames is not None:
        angles = record.frames.joint_angles_rad[record.rest_frames][::-1]
        numbers = rests_between_places(resting_reference(angles), frame_rad)
        rests += (before + numbers).tolist()
    return tuple(dict.fromkeys(rests)) or None
