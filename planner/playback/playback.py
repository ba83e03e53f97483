"""Playback: folding the straight chain by servoing through the reversed record."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.rotations import aligned_distances
from planner.clearance.sweep import sweep
from planner.errors import InputError, SimulationError
from planner.motion.angle_steps import packed_frames, snapped, unpacked_frames
from planner.motion.frames import Frames, Phase
from planner.motion.inverse import inverse_dynamics
from planner.motion.motion import Motion, motion_arrays, motion_from_arrays
from planner.motion.record import Record, save_npz
from planner.motion.windows import Windows
from planner.playback.controllers import ComputedTorque, Controller, RateServo, Servo
from planner.playback.kinematic import kinematic_frames, root_folded, windowed_frames
from planner.playback.reference import Reference, clear_reference
from planner.playback.setpoints import (
    Backwards,
    DirectSetpoints,
    Setpoints,
    Snapshots,
    SnapshotSetpoints,
    Target,
    TimedSetpoints,
)
from planner.playback.time_law import TimeLaw, hinge_bounded_law, torque_bounded_law
from planner.playback.unfolding import Unfolding
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.simulation.model import Material
from planner.simulation.parameters import PlaybackParameters
from planner.simulation.tree import RateMotors, Servos, Tree

Array = NDArray[np.float64]
PlaybackStatus = Literal["folded", "missed", "diverged", "cancelled", "timeout"]
FEWEST_STEPS: Final = 100
"""Steps of a playback, at least."""
SPEED_STEPS: Final = 2
"""Factor of the steps of a playback that is paced by its hinges: its ends go faster then."""
MOST_FINER: Final = 4
"""Factor of frames and steps up to which a plan is refined before it is played back."""
FRAME_RAD: Final = 0.04
"""Turn of a hinge between two frames of a kinematic playback, about."""
STEP_RAD: Final = 0.01
"""Turn of a hinge, or of its target, since the last frame, from which on a frame is recorded: in
nearly every step in which the chain moves, since the plan is swept at those before."""
FRAME_DISTANCE: Final = 0.2
"""Way of a module among the others since then, in pitches, from which on one is recorded, too."""
FRAME_STEPS: Final = 12
"""Steps between two frames, at most."""
ARRIVED_WITHIN: Final = 0.1
"""RMS position error in pitches up to which a playback has not missed its target."""
LAW_SAMPLES_A_RAD: Final = 180
"""Samples of the time law for each radian of the reference's length."""
REPORT_EVERY_S: Final = 0.1
CHECK_EVERY: Final = 25
"""Steps between two looks whether somebody wants it to stop."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Playback:
    """The outcome of a playback: simulated, or the reference itself.

    Attributes:
        status: ``folded`` when the chain got there, else what came of it.
        reason: In plain words; empty when folded.
        frames: Simulated configurations with their joint errors: from straight on or, of a
            refold, from where it begins on, over straight.
        reference_rad: (F, J) what the hinges should have been at those frames; None when the
            frames are windows, which are that themselves.
        steps: Simulation steps.
        seconds: Wall time.
        rms_position_error: Of the modules' centres at the end, in pitches, after alignment; None
            when it was not simulated.
        max_angle_error_rad: Largest joint error over all steps; None when it was not simulated.
        peak_torque: Largest hinge torque looked at, in units of module mass · pitch² / s².
        rms_torque: Root mean square over time of the largest hinge torque.
        kind: ``dynamic`` when it was simulated; ``kinematic`` when the reference itself was taken,
            for chains too long for the single tree. Joint errors are then NaN, torques those of
            inverse dynamics at frames spread over the motion.
        torque_frames: How many frames those are; None where torques are those of every step, or
            where an earlier version did not tell.
    """

    status: PlaybackStatus
    reason: str
    frames: Motion
    reference_rad: Array | None
    steps: int
    seconds: float
    rms_position_error: float | None
    max_angle_error_rad: float | None
    peak_torque: float | None
    rms_torque: float | None
    kind: Literal["dynamic", "kinematic"] = "dynamic"
    torque_frames: int | None = None

    @property
    def simulated(self) -> bool:
        """Whether a simulation made its frames."""
        return self.kind == "dynamic"

    @property
    def reference(self) -> Array | Windows:
        """What the plan is: (F, J) hinge angles, or windows."""
        if isinstance(self.frames, Windows):
            return self.frames
        if self.reference_rad is None:
            raise ValueError("got frames of all angles without their reference")
        return self.reference_rad

    def summary(self) -> dict[str, Any]:
        """The figures without the frames."""
        return {name: getattr(self, name) for name in _SCALARS}

    def save(self, path: FilePath) -> None:
        """Writes an ``.npz`` that is either whole or not there."""
        frames, reference = motion_arrays(self.frames), self.reference_rad
        if reference is not None and np.array_equal(reference, frames["joint_angles_rad"]):
            del frames["joint_angles_rad"]  # of a kinematic playback they are the same
        save_npz(
            path,
            {
                **{name: _stored(getattr(self, name)) for name in _SCALARS},
                **({} if reference is None else packed_frames("reference_rad", reference)),
                **frames,
            },
        )

    @classmethod
    def load(cls, path: FilePath) -> Playback:
        """Reads what ``save`` wrote."""
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
            reference = None
            if "offsets" not in arrays:
                reference = unpacked_frames(arrays, "reference_rad")
                arrays.setdefault("joint_angles_rad", reference)
            return cls(
                frames=motion_from_arrays(arrays),
                reference_rad=reference,
                **{name: _loaded(arrays[name].item()) for name in _SCALARS if name in arrays},
            )


def _stored(value: Any) -> NDArray[Any]:
    """A figure as an array; one that there is none of as NaN."""
    return np.array(np.nan if value is None else value)


def _loaded(value: Any) -> Any:
    return None if isinstance(value, float) and np.isnan(value) else value


_SCALARS: Final = (
    "status",
    "reason",
    "steps",
    "seconds",
    "rms_position_error",
    "max_angle_error_rad",
    "peak_torque",
    "rms_torque",
    "kind",
    "torque_frames",
)


def play_back(
    chain: Chain,
    record: Record | None,
    parameters: PlaybackParameters,
    *,
    module_size: float = 0.95,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
    start_s: float = 0.0,
    finer: int = 1,
    unfolding: Unfolding | None = None,
) -> Playback:
    """Folds the straight chain in simulation: no gravity, the chain floats.

    A refold is one simulation: the chain begins folded otherwise, unfolds, and goes on from there.

    Args:
        chain: The chain.
        record: The explosion to play in reverse; the ``direct`` controller needs none.
        parameters: Controller and reference.
        module_size: Size of the colliding modules as a fraction of the pitch.
        sink: Gets the frames as they are made.
        progress: Told how far it is, a few times a second.
        cancelled: Asked now and then whether to stop.
        start_s: Time of the first frame.
        finer: How many times as many frames to keep.
        unfolding: How the chain becomes straight first; None when it is.

    Raises:
        InputError: An unknown controller, or a controller that needs a record without one.
    """
    begun = time.perf_counter()
    recorded = None if record is None else record.frames
    if isinstance(recorded, Windows):
        if unfolding is not None:
            raise InputError(
                "cannot-refold",
                "a chain that is peeled cannot begin folded otherwise; fold it from straight.",
            )
        return _reversed_windows(chain, recorded, parameters, sink, start_s)
    if recorded is not None and not simulates(chain, recorded, parameters.dynamic_up_to):
        return _followed(chain, recorded, parameters, module_size, sink, start_s, finer, unfolding)
    run = _Run(chain, record, parameters, module_size, start_s, finer, unfolding)
    status, reason = run.simulate(sink, progress, cancelled)
    error = run.final_error()
    if status == "folded" and error > ARRIVED_WITHIN:
        status = "missed"
        reason = (
            f"the chain ended {error:.2g} pitches (RMS) from its target; "
            f"{run.bent_wrong()} of {len(chain.folded_rad)} hinges are off by more than 0.1 rad."
        )
    frames = Frames.joined(run.kept)
    return Playback(
        status=status,
        reason=reason,
        frames=frames,
        reference_rad=snapped(np.array(run.references)),
        steps=run.steps,
        seconds=time.perf_counter() - begun,
        rms_position_error=error,
        max_angle_error_rad=run.largest_error,
        peak_torque=run.peak_torque,
        rms_torque=float(np.sqrt(run.square_torque / max(1, run.steps))),
    )


def simulates(chain: Chain, recorded: Motion, dynamic_up_to: int) -> bool:
    """Whether the playback of a record is simulated; else it is kinematic.

    Args:
        chain: The chain.
        recorded: The explosion to play in reverse, or what came of it.
        dynamic_up_to: As in ``PlaybackParameters``.
    """
    return isinstance(recorded, Frames) and len(chain) <= dynamic_up_to


def _followed(
    chain: Chain,
    recorded: Frames,
    parameters: PlaybackParameters,
    module_size: float,
    sink: Callable[[Motion], None] | None,
    start_s: float,
    finer: int,
    unfolding: Unfolding | None,
) -> Playback:
    """A kinematic playback."""
    begun = time.perf_counter()
    kept: list[Frames] = []
    for frames in kinematic_frames(
        chain,
        recorded,
        parameters,
        module_size=module_size,
        start_s=start_s,
        frame_rad=FRAME_RAD / finer,
        unfolding=unfolding,
    ):
        kept.append(frames)
        if sink is not None:
            sink(frames)
    frames = Frames.joined(kept)
    return _kinematic(chain, frames, frames.joint_angles_rad, begun)


def _reversed_windows(
    chain: Chain,
    record: Windows,
    parameters: PlaybackParameters,
    sink: Callable[[Motion], None] | None,
    start_s: float,
) -> Playback:
    """A kinematic playback of windows."""
    begun = time.perf_counter()
    windows = windowed_frames(chain, record, parameters, start_s=start_s)
    if sink is not None:
        sink(windows)
    return _kinematic(chain, windows, None, begun)


def _kinematic(chain: Chain, frames: Motion, reference_rad: Array | None, begun: float) -> Playback:
    torques = inverse_dynamics(chain, frames)
    return Playback(
        status="folded",
        reason="",
        frames=frames,
        reference_rad=reference_rad,
        steps=0,
        seconds=time.perf_counter() - begun,
        rms_position_error=None,
        max_angle_error_rad=None,
        peak_torque=torques.peak if len(torques.frames) else None,
        rms_torque=torques.rms if len(torques.frames) else None,
        kind="kinematic",
        torque_frames=len(torques.frames),
    )


def _motors(p: PlaybackParameters) -> Servos | RateMotors | None:
    if p.controller == "computed-torque":
        return None
    if p.torque_limit is not None and p.controller in ("paper", "direct"):
        # The torque of a stiff servo jumps from one limit to the other; a constraint's does not.
        return RateMotors(torque_limit=p.torque_limit)
    return Servos(stiffness=p.stiffness, damping=p.stiffness / p.gain, torque_limit=p.torque_limit)


def _controller(p: PlaybackParameters, motors: Servos | RateMotors | None) -> Controller:
    if motors is None:
        return ComputedTorque(bandwidth=p.bandwidth, encoder_rad=p.encoder_rad)
    if isinstance(motors, RateMotors):
        return RateServo(gain=p.gain)
    return Servo(
        stiffness=motors.stiffness,
        damping=motors.damping,
        feed_forward=p.controller == "servo",
    )


def _whole(record: Record) -> Frames:
    """The frames of a record that is not of windows, which alone is simulated."""
    assert isinstance(record.frames, Frames)
    return record.frames


class _Run:
    def __init__(
        self,
        chain: Chain,
        record: Record | None,
        parameters: PlaybackParameters,
        module_size: float,
        start_s: float,
        finer: int,
        unfolding: Unfolding | None,
    ) -> None:
        self.chain = chain
        self.finer = finer
        self.parameters = parameters
        self.module_size = module_size
        self.start_s = start_s
        self.steps = 0
        self.largest_error = 0.0
        self.peak_torque = 0.0
        self.square_torque = 0.0
        self.kept: list[Frames] = []
        self.references: list[Array] = []
        self._sent = 0
        self.setpoints = self._all_setpoints(record, unfolding)
        motors = _motors(parameters)
        material = Material(geom_size=module_size, friction=parameters.friction)
        self.tree = Tree(
            chain,
            material,
            step_s=self.step_s,
            motors=motors,
            damping=parameters.damping,
        )
        self.at_rest = unfolding is not None or parameters.controller == "computed-torque"
        """Whether what integration adds to the momentum is taken away: large steps add some."""
        self.controller = _controller(parameters, motors)
        zero = np.zeros_like(chain.folded_rad)
        if unfolding is not None:
            self.tree.place(unfolding.chain.folded_rad, *root_folded(unfolding.chain))
        elif record is None:
            self.tree.place(zero, *root_folded(chain))
        else:
            last = _whole(record)[-1:]
            self.tree.place(zero, last.root_position[0], last.root_wxyz[0])

    @property
    def split(self) -> int:
        """Steps into which one of the parameters is divided.

        What is recorded in more frames is simulated in as many more. A servo's gain asks for steps
        that are shorter than its time constant.
        """
        p = self.parameters
        return self.finer * (int(np.ceil(p.step_s * p.gain)) if p.controller == "servo" else 1)

    @property
    def step_s(self) -> float:
        """Time of a step."""
        return self.parameters.step_s / self.split

    def _all_setpoints(
        self, record: Record | None, unfolding: Unfolding | None
    ) -> list[tuple[Phase, Setpoints]]:
        """What is followed, in its order."""
        p = self.parameters
        if p.controller == "direct":
            return [("playback", DirectSetpoints(self.chain.folded_rad, p.direct_steps, p.step_s))]
        if record is None:
            raise InputError("no-record", f"the controller {p.controller!r} needs a record.")
        angles = record.snapshots_rad
        snapshots = (_whole(record).joint_angles_rad if angles is None else angles)[::-1]
        if p.controller == "paper":
            folding: list[tuple[Phase, Setpoints]] = [("playback", self._snapshots(snapshots))]
            if unfolding is not None:
                back = Backwards(unfolding.time_s, unfolding.folding_rad, p.step_s)
                folding.insert(0, ("unfolding", self._snapshots(back)))
            return folding
        if p.controller not in ("computed-torque", "servo"):
            raise InputError(
                "unknown-controller",
                f"got the controller {p.controller!r}, expected computed-torque, servo, paper or "
                "direct.",
            )
        references = [self._reference(self.chain, snapshots)]
        if unfolding is not None:
            references.append(self._reference(unfolding.chain, unfolding.folding_rad))
        laws = self._clear_laws(references)
        timed: list[tuple[Phase, Setpoints]] = [
            ("playback", TimedSetpoints(references[0], laws[0]))
        ]
        if unfolding is not None:
            timed.insert(0, ("unfolding", TimedSetpoints(references[1], laws[1].backwards())))
        return timed

    def _snapshots(self, snapshots: Snapshots) -> SnapshotSetpoints:
        p = self.parameters
        return SnapshotSetpoints(
            snapshots, threshold_rad2=p.threshold_rad2, least_steps=p.least_steps
        )

    def _reference(self, chain: Chain, snapshots: Array) -> Reference:
        """A smooth curve through configurations from straight on."""
        p = self.parameters
        return clear_reference(
            chain,
            snapshots,
            spacing_rad=p.spacing_rad,
            distance_weight=p.distance_weight,
            size=self.module_size,
        )

    def _clear_laws(self, references: list[Reference]) -> list[TimeLaw]:
        """How fast to run along the curves: in more steps where straight lines between them touch.

        A plan joins its frames by straight lines. So it is swept before it is played back.
        """
        while True:
            laws = [self._law(reference) for reference in references]
            if self.finer >= MOST_FINER or all(
                sweep(self.chain, one.spline(law.u), size=self.module_size, share=0.0).clearance
                > 0.0
                for one, law in zip(references, laws, strict=True)
            ):
                return laws
            self.finer *= 2

    def _law(self, reference: Reference) -> TimeLaw:
        p = self.parameters
        steps = max(FEWEST_STEPS, int(self.split * p.steps_per_rad * reference.length_rad))
        samples = max(100, int(LAW_SAMPLES_A_RAD * reference.length_rad))
        if p.paced_by == "speed":
            return hinge_bounded_law(
                reference, steps=SPEED_STEPS * steps, step_s=self.step_s, samples=samples
            )
        return torque_bounded_law(
            reference, self.chain.module, steps=steps, step_s=self.step_s, samples=samples
        )

    def simulate(
        self, sink: Callable[[Frames], None] | None, progress: Report, cancelled: Cancelled
    ) -> tuple[PlaybackStatus, str]:
        tree = self.tree
        reported, reported_steps = time.perf_counter(), 0
        last_angles = last_aim = np.full_like(self.chain.folded_rad, np.inf)
        last_centres = np.full((len(self.chain), 3), np.inf)
        last_step = 0
        target = None
        part, begun = 0, 0
        try:
            while self.steps - begun < self.parameters.max_steps:
                tree.begin_step()
                angles = tree.angles
                phase, setpoints = self.setpoints[part]
                following = setpoints.target(angles, tree.rates)
                if following is None:
                    assert target is not None
                    if part + 1 < len(self.setpoints):
                        # The first frame of the next part is here, where this one has ended.
                        part, begun = part + 1, self.steps
                        last_angles = np.full_like(last_angles, np.inf)
                        continue
                    self._keep(phase, angles, target, sink)
                    return "folded", ""
                target = following
                error = float(np.abs(target.angles - angles).max())
                self.largest_error = max(self.largest_error, error)
                if (
                    max(np.abs(angles - last_angles).max(), np.abs(target.angles - last_aim).max())
                    >= STEP_RAD / self.finer
                    or ((tree.centres - last_centres) ** 2).sum(axis=1).max()
                    >= (FRAME_DISTANCE / self.finer) ** 2
                    or self.steps - last_step >= FRAME_STEPS
                ):
                    self._keep(phase, angles, target, sink)
                    last_angles, last_aim, last_step = angles, target.angles, self.steps
                    last_centres = tree.centres
                self.controller.drive(tree, target)
                tree.end_step()
                if self.at_rest:
                    tree.stop_drifting()
                torque = float(np.abs(tree.motor_torques).max())
                self.peak_torque = max(self.peak_torque, torque)
                self.square_torque += torque * torque
                self.steps += 1
                if self.steps % CHECK_EVERY == 0:
                    if cancelled():
                        return "cancelled", "it was cancelled."
                    now = time.perf_counter()
                    if now - reported >= REPORT_EVERY_S:
                        rate = (self.steps - reported_steps) / (now - reported)
                        progress(
                            Progress(
                                stage="play_back",
                                fraction=min((part + target.fraction) / len(self.setpoints), 0.99),
                                steps=self.steps,
                                steps_per_second=rate,
                                simulated_s=self.steps * self.step_s,
                                message="folding" if phase == "playback" else phase,
                            )
                        )
                        reported, reported_steps = now, self.steps
        except SimulationError as broken:
            return "diverged", f"the simulation broke off: {broken}"
        return "timeout", (
            f"the chain had not come to rest in its folded shape after {self.parameters.max_steps} "
            f"steps: it is {self.final_error():.2g} pitches (RMS) from there, and "
            f"{self.bent_wrong()} of {len(self.chain.folded_rad)} hinges are off by more than "
            "0.1 rad."
        )

    def _keep(
        self,
        phase: Phase,
        angles: Array,
        target: Target,
        sink: Callable[[Frames], None] | None,
    ) -> None:
        frame = Frames.of_phase(
            phase,
            time_s=np.array([self.start_s + self.steps * self.step_s]),
            joint_angles_rad=angles[None],
            root_position=self.tree.root_position[None],
            root_wxyz=self.tree.root_wxyz[None],
            joint_error_rad=np.abs(target.angles - angles)[None],
        )
        self.kept.append(frame)
        self.references.append(target.angles.copy())
        if sink is not None:
            sink(frame)

    def final_error(self) -> float:
        """RMS distance of the modules from the folded shape in pitches, after alignment."""
        # A simulation that broke off leaves no numbers; its last sound frame counts.
        angles = self.tree.angles
        if not np.isfinite(angles).all():
            angles = self.kept[-1].joint_angles_rad[-1]
        poses = self.chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        distances = aligned_distances(poses.positions, self.chain.folded_poses.positions)
        return float(np.sqrt((distances**2).mean()))

    def bent_wrong(self) -> int:
        """Hinges more than 0.1 rad from where they should end."""
        return int((np.abs(self.tree.angles - self.chain.folded_rad) > 0.1).sum())
