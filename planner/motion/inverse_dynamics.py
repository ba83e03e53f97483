"""Inverse dynamics of a kinematic playback: the torques that its motion would take.

It costs time in proportion to frames × modules, so for a long motion some frames are computed,
spread evenly; torques between them may be larger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import floating_torques
from foldback.planner.motion.motion import Motion


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Torques:
    """The largest hinge torques at some frames of a motion.

    Attributes:
        frames: (K,) numbers of the frames, rising.
        largest: (K,) largest torque there, in units of module mass · pitch² / s².
        hinges: (K,) index of the hinge with that torque.
        rms: Root mean square of ``largest`` over time.
    """

    frames: Ints
    largest: Array
    hinges: Ints
    rms: float

    @property
    def peak(self) -> float:
        """Largest torque of all; 0 without frames."""
        return float(self.largest.max(initial=0.0))


def inverse_dynamics(chain: Chain, motion: Motion) -> Torques:
    """Compute torques of a chain that floats freely, without gravity, momentum or contacts.

    Speeds and accelerations at a frame are those of the parabola through it and its neighbours.

    Args:
        chain: The chain.
        motion: Motion of three frames or more; of neighbours at one time only the first counts.
    """
    later = np.concatenate([[0], np.flatnonzero(np.diff(motion.time_s) > 0.0) + 1])
    inner = len(later) - 2
    if inner < 1:
        none = np.zeros(0, np.int64)
        return Torques(frames=none, largest=np.zeros(0), hinges=none, rms=0.0)
    count = min(inner, max(1, 2_000_000 // len(chain)))
    middle = 1 + np.unique(np.linspace(0, inner - 1, count).astype(np.int64))
    largest, hinges = np.empty(len(middle)), np.empty(len(middle), np.int64)
    step = max(1, 2**18 // len(chain.folded_rad))
    for start in range(0, len(middle), step):
        part = middle[start : start + step]
        around = [motion[later[part + shift]] for shift in (-1, 0, 1)]
        times = [frames.time_s for frames in around]
        angles = [frames.angles(chain) for frames in around]
        rates, accelerations = _parabolas(times, angles)
        torques = np.abs(floating_torques(chain.module, angles[1], rates, accelerations))
        hinges[start : start + step] = torques.argmax(axis=1)
        largest[start : start + step] = torques.max(axis=1)
    frames = later[middle]
    weights = np.gradient(motion.time_s[frames]) if len(frames) > 1 else np.ones(1)
    rms = float(np.sqrt(np.average(largest**2, weights=np.maximum(weights, 1e-12))))
    return Torques(frames=frames, largest=largest, hinges=hinges, rms=rms)


def _parabolas(times: list[Array], angles: list[Array]) -> tuple[Array, Array]:
    """Return (K, J) first and second derivatives at the middle one of three frames each.

    Args:
        times: Three (K,) arrays of times: before, at and after, s.
        angles: Three (K, J) arrays of angles, rad.
    """
    earlier = (times[1] - times[0])[:, None]
    later = (times[2] - times[1])[:, None]
    come = (angles[1] - angles[0]) / earlier
    go = (angles[2] - angles[1]) / later
    rates = (come * later + go * earlier) / (earlier + later)
    return rates, 2.0 * (go - come) / (earlier + later)
