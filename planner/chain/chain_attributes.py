"""Chain attributes: the plain JSON values of a chain in timelines, plans and lists of attempts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foldback.planner.chain.built_in_modules import module_of, module_value
from foldback.planner.chain.chain import Chain
from foldback.planner.storage.plain_values import from_plain


def chain_attributes(chain: Chain) -> dict[str, Any]:
    """Return the description of a chain in a timeline or plan, as plain JSON values."""
    return {
        "name": chain.name,
        "module": module_value(chain.module),
        "modules": len(chain),
        "pitch_m": chain.pitch_m,
        "root": chain.root,
        "joint_names": list(chain.joint_names),
        "folded_rad": chain.folded_rad.tolist(),
        "folded_position": chain.folded_position.tolist(),
        "folded_wxyz": chain.folded_wxyz.tolist(),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _ChainValues:
    """Values that are read of those that ``chain_attributes`` returns."""

    name: str
    module: str | dict[str, Any]
    folded_rad: list[float]
    folded_position: tuple[float, float, float]
    folded_wxyz: tuple[float, float, float, float]
    pitch_m: float


def chain_from_attributes(attributes: Any) -> Chain:
    """Build the chain described by ``chain_attributes``.

    Raises:
        ValueError: A value is missing, or has another type.
        InputError: The module is unknown, or its description is not valid.
    """
    values = from_plain(attributes, _ChainValues)
    return Chain(
        name=values.name,
        module=module_of(values.module),
        folded_rad=np.array(values.folded_rad, dtype=np.float64),
        folded_position=np.array(values.folded_position, dtype=np.float64),
        folded_wxyz=np.array(values.folded_wxyz, dtype=np.float64),
        pitch_m=values.pitch_m,
    )
