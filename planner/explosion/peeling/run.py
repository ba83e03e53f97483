"""Run of a peeling: when a unit is released, joints retire, and the run restarts or ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, Protocol

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.explosion.loop.checkpoint import (
    MAX_CHECKPOINT_RETRIES,
    MAX_STALLED_PULSES,
    BendDecrease,
)
from foldback.planner.explosion.loop.explosion_loop import (
    COMMIT_EVERY_STEPS,
    STRAIGHT,
    End,
    Explosion,
    return_to_checkpoint,
)
from foldback.planner.explosion.loop.recorder import TOO_CLOSE, Mark, Refusal
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.explosion.loop.straightening import KINEMATIC_FRAME_S
from foldback.planner.explosion.peeling.recorder import Proof
from foldback.planner.explosion.peeling.window import ReleasePoint, Window, WindowConfiguration
from foldback.planner.motion.record import Spent
from foldback.planner.parameters.explosion import PeelingParameters
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code

MIN_RETIRED_JOINTS: Final = 6
"""Minimum number of straight joints that become part of the rigid tail at a time, as the model is
rebuilt each time."""
CHECK_STEPS: Final = 5
"""Number of simulation steps after which a run may release a unit. All other checks come after
multiples of it, so that so many steps are made at a time."""
SAME_HEADING_COSINE: Final = 0.9
"""Minimum cosine of the angle by which the rigid tail turns if nearly straight joints become part
of it; with a larger angle they stay simulated."""


class PeelingRules(Protocol):
    """Rules of releases, and remedies for a jam, of the place where a chain is peeled."""

    max_finish_contacts: ClassVar[float]
    """Maximum number of contacts with which the last joints may be straightened."""

    def is_ready(self, window: Window, control: StepControl) -> bool:
        """Return True if the next unit may be released."""
        ...

    def is_ready_in_jam(self, window: Window, control: StepControl) -> bool:
        """Return True if the next unit may be released while the chain is jammed."""
        ...

    def allows(self, configurations: Sequence[WindowConfiguration]) -> bool:
        """Return True if configurations, one after the other, may be recorded."""
        ...

    def committed(self) -> None:
        """Receive that the present state is the checkpoint."""

    def released(self, point: ReleasePoint, mark: Mark[WindowConfiguration], first: int) -> None:
        """Receive the state before a release, the record's end, and the window's first module."""

    def answer(self, refusal: Refusal, window: Window, step: int) -> None:
        """Change the forces after the guard has refused snapshots."""

    def loosen(self, step: int) -> None:
        """Change the forces after many restarts from the same checkpoint."""

    def loosen_jam(self, step: int) -> None:
        """Change the forces after a jam, which the pulses have counted."""

    def progressed(self) -> None:
        """Receive that the chain moves again after a jam."""

    def retreat(self, peeling: Peeling) -> bool:
        """Return to an earlier release; return False if the run does not."""
        ...

    def end(self, window: Window) -> End | None:
        """Return the end of a run that has reached a limit of the forces."""
        ...


@dataclass(slots=True, kw_only=True, eq=False)
class Peeling(Explosion[Window, WindowConfiguration]):
    """Run in which one unit after the other is released.

    Attributes:
        proof: Proof of the clearance of snapshots.
        progress: Detector of jams.
        rules: Rules of releases, and remedies for a jam.
        refusal: Refusal of the guard that has not been answered yet.
    """

    proof: Proof
    progress: BendDecrease
    rules: PeelingRules
    refusal: Refusal | None = None

    @property
    def parameters(self) -> PeelingParameters:
        """Parameters of the peeling."""
        return self.world.setting.parameters

    @property
    def max_steps(self) -> int:
        """Maximum number of steps of the run, by the chain's length."""
        return self.parameters.most_steps(len(self.world.setting.peelable))

    @property
    def error_limit(self) -> Spent:
        """Number of pushes without progress after which an error ends the run."""
        return Spent("pushes", MAX_STALLED_PULSES["peel"], self.pulses.count)

    def begin(self) -> None:
        """Record the folded configuration."""
        self.world.place()
        self.record()
        self.refusal = self.recorder.commit()

    def record(self) -> None:
        """Record the present state."""
        self.recorder.add(self.world.snapshot())

    def go_on(self) -> End | None:
        """Make steps up to the next check, and return how the run ends there, or None."""
        return self.check_step(moved=self.make_steps())

    def make_steps(self) -> bool:
        """Make steps up to the next check; return False if the run restarted instead.

        Raises:
            SimulationError: When the numbers are bad and the run may not restart.
        """
        control, forces = self.control, self.world.setting.forces
        count = min(
            forces.max_steps,
            CHECK_STEPS - control.steps % CHECK_STEPS,
            self.max_steps - control.steps,
        )
        return self.end_steps(*self.world.make_steps(control, count))

    def close(self, end: End) -> None:
        """Make all steps final."""
        self.recorder.close()

    def may_restart(self, *, after_error: bool) -> bool:
        """Return True unless an error comes after too many pushes in a row."""
        limit = self.error_limit
        return not after_error or limit.used < limit.allowed

    def restart(self) -> None:
        """Restart from the checkpoint; change the forces if that has not helped before."""
        return_to_checkpoint(self)
        checkpoint, steps = self.checkpoint, self.control.steps
        refusal, self.refusal = self.refusal, None
        if refusal is not None:
            self.rules.answer(refusal, self.world, steps)
        elif checkpoint.retries > MAX_CHECKPOINT_RETRIES:
            checkpoint.retries = 0
            self.rules.loosen(steps)
            self.world.state.scale_velocities(0.0)

    def check_step(self, *, moved: bool) -> End | None:
        """Commit, retire, release; end a run that is straight, stuck or cancelled."""
        control, window = self.control, self.world
        steps = control.steps
        if steps % COMMIT_EVERY_STEPS == 0:
            if moved and control.is_shallow:
                self.commit()
            if (end := self.watch.check(self)) is not None:
                return end
        if (end := self.rules.end(window)) is not None:
            return end
        if steps % 20 == 0 and control.is_shallow:
            self.retire()
        if window.first and steps % CHECK_STEPS == 0 and self.rules.is_ready(window, self.control):
            self.release()
        if not window.first and steps % 25 == 0 and self.finish():
            return STRAIGHT
        if steps % 50 == 0:
            self.check_progress()
            if self.pulses.are_used_up and not self.rules.retreat(self):
                return self.rules.end(window) or self._stalled()
        return None

    def commit(self) -> None:
        """Make the present state the checkpoint, if it keeps the clearance."""
        if self.proof.is_clear([self.world.snapshot()]) and self.settle():
            self.save()
            self.rules.committed()

    def save(self) -> None:
        """Make the present state the checkpoint."""
        self.checkpoint.save(self.world.time_s, self.world.state)

    def settle(self) -> bool:
        """Record the present state as a snapshot, as the window changes after it.

        Returns:
            False if it is refused: then the run has restarted.
        """
        self.world.place()
        self.record()
        refusal = self.recorder.commit(min_clearance=self.proof.min_clearance)
        if refusal is not TOO_CLOSE:
            self.refusal = refusal
        if refusal is not None:
            self.restart()
            return False
        self.world.time_s += 1e-6
        return True

    def release(self) -> None:
        """Release the next unit."""
        point = self.world.release_point()
        if self.settle():
            self.world.release()
            self.save()
            self.rules.released(point, self.recorder.mark(), self.world.first)

    def retire(self) -> None:
        """Make the outer hinges that are nearly straight part of the rod."""
        p, window = self.parameters, self.world
        window.place()
        bent = window.bends_rad
        if bent[-MIN_RETIRED_JOINTS:].max() >= p.retire_rad:
            return
        heights = window.heights(window.model.positions)
        good = (bent < p.retire_rad) & (heights[1:-1] > p.retire_height)
        count = len(good) if good.all() else int(np.argmin(good[::-1]))
        count = min(count, len(good) - 4)
        while count >= MIN_RETIRED_JOINTS:
            configurations = self._straightened(count)
            if configurations is not None:
                break
            count //= 2
        else:
            return
        if self.settle():
            self.recorder.append(configurations)
            window.time_s = configurations[-1].time_s + 1e-6
            window.retire(configurations[-1].angles)
            self.save()

    def _straightened(self, count: int) -> list[WindowConfiguration] | None:
        """Return snapshots that straighten the last ``count`` joints; None if modules touch."""
        window, angles = self.world, self.world.state.angles
        remaining = angles[: len(angles) - window.setting.peelable.hinges * count]
        _, rotations = window.setting.peelable.poses(window.first, remaining)
        turned = float(rotations[-1][:, 0] @ window.rod_direction)
        if turned < SAME_HEADING_COSINE:
            return None
        bent = float(np.abs(angles[len(remaining) :]).max())
        largest = max(float(np.arccos(min(turned, 1.0))), bent)
        frames = int(np.ceil(largest / self.parameters.retire_step_rad))
        configurations: list[WindowConfiguration] = []
        for k in range(1, frames):
            partly = angles.copy()
            partly[len(remaining) :] *= 1.0 - k / frames
            configurations.append(self._frame(k, partly))
        configurations.append(self._frame(frames, remaining.copy()))
        return configurations if self._may_follow(configurations) else None

    def finish(self) -> bool:
        """Straighten the window by pure kinematics; return False if modules may touch."""
        p, angles = self.parameters, self.world.state.angles.copy()
        largest = float(np.abs(angles).max(initial=0.0))
        contacts = self.control.contacts
        if largest > p.finish_rad or contacts > self.rules.max_finish_contacts:
            return False
        count = int(np.ceil(max(largest / p.snapshot_rad, 1.0)))
        configurations = [self._frame(k, (1.0 - k / count) * angles) for k in range(1, count + 1)]
        if not self._may_follow(configurations) or not self.settle():
            return False
        self.recorder.append(configurations)
        return True

    def _frame(self, k: int, angles: Array) -> WindowConfiguration:
        """Return the ``k``-th configuration of a kinematic motion from the present state."""
        return self.world.bent_to(angles, self.world.time_s + k * KINEMATIC_FRAME_S)

    def _may_follow(self, configurations: list[WindowConfiguration]) -> bool:
        """Return True if configurations may be recorded after the present state."""
        motion = [self.world.snapshot(), *configurations]
        return self.proof.is_clear(motion) and self.rules.allows(motion)

    def check_progress(self) -> None:
        """Release a unit or change the forces if nothing moves."""
        pulses, steps = self.pulses, self.control.steps
        result = self.progress.check(self.world.remaining_rad, steps)
        if result == "progress" and pulses.count:
            pulses.count = 0
            self.rules.progressed()
        elif result == "jam":
            pulses.count += 1
            if self.world.first and self.rules.is_ready_in_jam(self.world, self.control):
                self.release()
            else:
                self.rules.loosen_jam(steps)

    def _stalled(self) -> End:
        """Return the end of a stuck run: the modules that are released, and the most bent joint."""
        window, pulses = self.world, self.pulses
        bends = window.bends_rad
        worst = int(np.argmax(bends))
        reason = Reason.of(
            Code.STUCK_PEELING,
            folded=window.first + 1 if window.first else None,
            pushes=pulses.count,
            module=window.first + 1 + worst,
            bend_rad=float(bends[worst]),
        )
        return End("stalled", reason, pulses.spent)
