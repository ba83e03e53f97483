"""Chain attributes: the plain JSON values of a chain in timelines, plans and lists of attempts."""

from __future__ import annotations

from typing import Any

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import module_named


def chain_attributes(chain: Chain) -> dict[str, Any]:
    """Return the description of a chain in a timeline or plan, as plain JSON values."""
    return {
        "name": chain.name,
        "module": chain.module.name,
        "modules": len(chain),
        "pitch_m": chain.pitch_m,
        "root": chain.root,
        "joint_names": list(chain.joint_names),
        "folded_rad": chain.folded_rad.tolist(),
        "folded_position": chain.folded_position.tolist(),
        "folded_wxyz": chain.folded_wxyz.tolist(),
    }


def chain_from_attributes(attributes: dict[str, Any]) -> Chain:
    """Build the chain described by ``chain_attributes``."""
    return Chain(
        name=str(attributes["name"]),
        module=module_named(attributes["module"]),
        folded_rad=np.asarray(attributes["folded_rad"], dtype=np.float64),
        folded_position=np.asarray(attributes["folded_position"], dtype=np.float64),
        folded_wxyz=np.asarray(attributes["folded_wxyz"], dtype=np.float64),
        pitch_m=float(attributes["pitch_m"]),
    )
