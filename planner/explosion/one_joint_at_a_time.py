"""One joint at a time: the baseline that bends a chain's joints in their order, and nothing else.

No simulation is needed: the chain is folded up to some joint and straight behind it, so its record
is computed at once. The certificate checks whether its modules touch on the way.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from planner.chain.chain import Chain
from planner.motion.angle_encoding import quantised
from planner.motion.motion import Motion
from planner.motion.record import Record
from planner.parameters.parameters import BASELINE

MAX_FRAME_TURN_RAD: Final = 0.4
"""Maximum rotation between two frames, rad, of the joint that straightens in the baseline that
moves one joint after the other. Smaller values record more frames. Chosen."""
BASELINE_RATE_RAD_S: Final = 0.25
"""Rate of the joint that straightens, rad/s, in the baseline that moves one joint after the other.
It only sets the times of the recorded frames; the folding motion gets its own timing. Chosen."""


def unbend_one_by_one(chain: Chain, *, sink: Callable[[Motion], None] | None = None) -> Record:
    """Return the record of a chain whose joints are straightened from the last one to the first.

    Args:
        chain: The chain.
        sink: Receives the snapshots.
    """
    begun = time.perf_counter()
    per_joint = chain.module.hinges_per_joint
    joints = chain.folded_rad.reshape(-1, per_joint)
    first, angles, times = [len(chain.folded_rad)], [np.zeros(0)], [0.0]
    for joint in np.flatnonzero(np.abs(joints).max(axis=1))[::-1]:
        largest = float(np.abs(joints[joint]).max())
        count = int(np.ceil(largest / MAX_FRAME_TURN_RAD))
        for k in range(1, count + 1):
            first.append(per_joint * int(joint))
            angles.append((1.0 - k / count) * joints[joint])
            times.append(times[-1] + largest / count / BASELINE_RATE_RAD_S)
    frames = Motion.from_windows(
        time_s=np.array(times),
        phase="explosion",
        first=np.array(first, dtype=np.int64),
        offsets=np.concatenate([[0], np.cumsum([len(part) for part in angles])]),
        angles_rad=quantised(np.concatenate(angles)).astype(np.float32),
        base_position=np.tile(chain.folded_position, (len(times), 1)),
        base_wxyz=np.tile(chain.folded_wxyz, (len(times), 1)),
    )
    if sink is not None:
        sink(frames)
    return Record(
        status="straight",
        reason="",
        frames=frames,
        steps=0,
        seconds=time.perf_counter() - begun,
        strategy=BASELINE,
    )
