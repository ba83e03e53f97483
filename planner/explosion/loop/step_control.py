"""Step control: time step, drag and tension of an explosion, which adapt to speeds and contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.core import adapt_tension, limit_speeds
from foldback.planner.core.structures import ContactModel, Controlled, ControlLimits
from foldback.planner.parameters.explosion import ExplosionParameters, PeelingParameters
from foldback.planner.simulation.mujoco_models import SOLIMP
from foldback.planner.simulation.reduced_state import State

WEAK_TENSION_SCALE: Final = 0.05
"""Factor of the force that pulls the chain straight in the first part of a pulse that loosens a
jam; deep contacts reduce it to no less. Measured from 0.035 to 0.07 in pulses of a thick trefoil:
other motions, equally good (decision 0051)."""
MIN_CONTACT_TIME_CONSTANT_S: Final = 0.03
"""Minimum time constant of the contact springs, s; above it, the time constant is two time steps,
MuJoCo's limit of stability. Measured from 0.021 to 0.042: equally good (decision 0051)."""
CONTACT_MODEL: Final = ContactModel(MIN_CONTACT_TIME_CONSTANT_S, 1.0, np.array(SOLIMP))
"""Stiffness of contacts in an explosion; their time constant is that of the smallest steps."""


@dataclass(frozen=True, slots=True)
class ContactDepth:
    """Limits of the depth of contacts during an explosion, in pitches.

    Attributes:
        limit: Maximum depth; a run restarts from its checkpoint when a contact is deeper.
        back_off: Depth beyond which the tension falls.
    """

    limit: float
    back_off: float

    @classmethod
    def within(cls, room: float, deepest: float) -> ContactDepth:
        """Build the limits for the room that the size to verify leaves, at most ``deepest``."""
        depth = float(np.clip(room, 0.002, deepest))
        return cls(depth, 0.7 * depth)


@dataclass(slots=True, kw_only=True)
class StepControl:
    """Time step, drag and tension of the next step, and the depth of contacts that they answer.

    Attributes:
        step_range_s: Minimum and maximum time step, s.
        drag_range: Minimum and maximum drag α, 1/s.
        max_step_in_contact_s: Maximum time step while modules touch, s.
        allowed: Limits of the depth of contacts.
        depth_after_restart: Depth, pitches, that counts as that of the step before a checkpoint:
            infinite where the checkpoint's own contacts may be deeper than allowed.
        step_s: Time step, s.
        drag: Drag α, 1/s.
        tension: Factor of the tension, 0…1.
        steps: Number of steps so far.
        depth: Depth of the deepest contact in the last step, pitches.
        contacts: Number of contacts in the last step that moved on.
    """

    step_range_s: tuple[float, float]
    drag_range: tuple[float, float]
    max_step_in_contact_s: float
    allowed: ContactDepth
    depth_after_restart: float = 0.0
    step_s: float
    drag: float = 1.0
    tension: float = 1.0
    steps: int = 0
    depth: float = 0.0
    contacts: int = 0

    @classmethod
    def adaptive(
        cls,
        parameters: ExplosionParameters | PeelingParameters,
        allowed: ContactDepth,
        *,
        depth_after_restart: float = 0.0,
    ) -> StepControl:
        """Build the control of an explosion by its parameters."""
        return cls(
            step_range_s=parameters.step_s,
            drag_range=parameters.drag,
            max_step_in_contact_s=parameters.step_in_contact_s,
            allowed=allowed,
            depth_after_restart=depth_after_restart,
            step_s=5.0 * parameters.step_s[0],
        )

    @classmethod
    def fixed(cls, step_s: float, drag: float) -> StepControl:
        """Build a control whose step and drag are constant, whatever the contacts."""
        return cls(
            step_range_s=(step_s, step_s),
            drag_range=(drag, drag),
            max_step_in_contact_s=step_s,
            allowed=ContactDepth(np.inf, np.inf),
            step_s=step_s,
            drag=drag,
        )

    @property
    def contact_time_constant_s(self) -> float:
        """Time constant of contacts in this step, s."""
        return max(2.0 * self.step_s, MIN_CONTACT_TIME_CONSTANT_S)

    @property
    def is_shallow(self) -> bool:
        """True if no contact is deep enough to lower the tension."""
        return self.depth < self.allowed.back_off

    @property
    def limits(self) -> ControlLimits:
        """Limits, as kernels take them."""
        return ControlLimits(
            *self.step_range_s,
            *self.drag_range,
            self.max_step_in_contact_s,
            WEAK_TENSION_SCALE,
            self.allowed.limit,
            self.allowed.back_off,
        )

    @property
    def controlled(self) -> Controlled:
        """Numbers that adapt, as kernels take and return them."""
        return Controlled(
            self.step_s, self.drag, self.tension, self.depth, self.contacts, self.steps
        )

    def go_on_with(self, controlled: Controlled) -> None:
        """Take over the numbers that have adapted."""
        (
            self.step_s,
            self.drag,
            self.tension,
            self.depth,
            self.contacts,
            self.steps,
        ) = controlled

    def is_too_deep(self, depth: float) -> bool:
        """Return True if contacts are deeper than allowed and than in the step before."""
        return depth > self.allowed.limit and depth > self.depth

    def adapt_tension(self, depth: float) -> None:
        """Adapt the tension to the depth of contacts, pitches."""
        self.go_on_with(adapt_tension(self.controlled, self.limits, depth))

    def limit_speeds(self, state: State, inverse_step_limit: float, contacts: int) -> None:
        """Scale all velocities to what one step allows; adapt time step and drag.

        Args:
            state: State whose velocities are scaled.
            inverse_step_limit: 1/Δt_max, 1/s: the step is allowed while its product is at most 1.
            contacts: Number of contacts.
        """
        controlled, scale = limit_speeds(self.controlled, self.limits, inverse_step_limit, contacts)
        state.scale_velocities(scale)
        self.go_on_with(controlled)

    def restart(self) -> None:
        """Go on from a checkpoint with a smaller step and less tension."""
        self.step_s = max(self.step_range_s[0], 0.5 * self.step_s)
        self.tension = max(WEAK_TENSION_SCALE, 0.5 * self.tension)
        self.depth = self.depth_after_restart
