"""``foldback-chain/1``: the folded configuration of a chain, joint by joint."""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.built_in_modules import DEFAULT_MODULE, module_of
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_checks import check_module
from foldback.planner.chain.path import MAX_COORDINATE
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, described, quote, too_many
from foldback.planner.readers.strict_json import name_field, pitch_field, refuse_unread_keys

CHAIN_FORMAT: Final = "foldback-chain/1"
CHAIN_KEYS: Final = (
    *("format", "name", "module", "joint_angles_deg", "pitch_m"),
    *("first_position", "first_wxyz"),
)


def read_chain(document: dict[str, Any], source: Source) -> Chain:
    """Return a chain from a ``foldback-chain/1`` object.

    Raises:
        InputError: The object is no valid chain; names the key, the joint or the modules.
    """
    refuse_unread_keys(document, CHAIN_KEYS)
    kind = document.get("module", DEFAULT_MODULE)
    if not isinstance(kind, str | dict):
        raise InputError(
            "wrong-type",
            f"got {described(kind)}, expected the name of a module or its description.",
            where="module",
        )
    module = module_of(quote(kind) if isinstance(kind, str) else cast("dict[str, Any]", kind))
    if not isinstance(kind, str):
        check_module(module)
    angles_deg = _angles(document, module, source)
    _refuse_radians(angles_deg)
    _refuse_turns(angles_deg)
    return Chain.from_angles(
        module,
        np.deg2rad(angles_deg),
        name=name_field(document) or source.name or "chain",
        pitch_m=pitch_field(document),
        first_position=_vector(document, "first_position", 3),
        first_wxyz=_vector(document, "first_wxyz", 4),
    )


def _vector(document: dict[str, Any], key: str, length: int) -> Array | None:
    """Return the numbers under a key; None if it is missing."""
    if (value := document.get(key)) is None:
        return None
    values = cast("list[Any]", value) if isinstance(value, list) else []
    numbers = [v for v in values if type(v) in (int, float) and abs(v) <= MAX_COORDINATE]
    if len(values) != length or len(numbers) != length:
        raise InputError(
            "wrong-type", f"got {described(value)}, expected {length} finite numbers.", where=key
        )
    return np.array(numbers, dtype=np.float64)


def _angles(document: dict[str, Any], module: Module, source: Source) -> list[float]:
    joints = document.get("joint_angles_deg")
    if not isinstance(joints, list) or not joints:
        text = "nothing" if "joint_angles_deg" not in document else described(joints)
        raise InputError(
            "wrong-type",
            f"got {text}, expected a list of {_joint_words(module)}, one for each joint.",
            where="joint_angles_deg",
        )
    rows = cast("list[Any]", joints)
    if len(rows) + 1 + module.rigid_links > source.max_cells:
        raise too_many(len(rows) + 1 + module.rigid_links, source.max_cells, "modules")
    angles: list[float] = []
    for index, row in enumerate(rows):
        values = cast("list[Any]", row) if isinstance(row, list) else [row]
        if len(values) != module.hinges_per_joint:
            raise InputError(
                "wrong-count",
                f"got {quote(row)}, expected {_joint_words(module)} in degrees.",
                where=f"joint {index}",
            )
        for value in values:
            if type(value) is not int and type(value) is not float:
                raise InputError(
                    "not-a-number",
                    f"got {described(value)}, expected an angle in degrees"
                    f"{' without quotation marks' if isinstance(value, str) else ''}.",
                    where=f"joint {index}",
                )
            angles.append(float(value))
    return angles


def _refuse_radians(angles: list[float]) -> None:
    """Refuse angles that are all quarter turns in radians, where degrees are expected.

    Raises:
        InputError: ``radians``.
    """
    turned = np.array([angle for angle in angles if angle], dtype=np.float64)
    if not len(turned) or np.abs(turned).max() > 6.3:  # one turn in rad
        return
    quarters = turned / (np.pi / 2)
    # 1.57 counts
    if (np.abs(quarters - np.round(quarters)) < 0.01).all() and np.round(quarters).all():
        raise InputError(
            "radians",
            f"got angles such as {turned[0]:g}, expected angles in degrees. The angles look "
            "like radians; multiply them by 180/π.",
            where="joint_angles_deg",
        )


def _refuse_turns(angles: list[float]) -> None:
    """Refuse angles that are all counts of quarter turns, where degrees are expected.

    Raises:
        InputError: ``quarter-turns``.
    """
    turned = {abs(angle) for angle in angles} - {0.0}
    if turned and turned <= {1.0, 2.0, 3.0}:  # they look like counts of quarter turns
        raise InputError(
            "quarter-turns",
            f"got angles up to {max(turned):g}, expected angles in degrees. The angles look like "
            "quarter turns; multiply them by 90.",
            where="joint_angles_deg",
        )


def _joint_words(module: Module) -> str:
    if not any(module.hinge_names):
        return "angles"
    return f"[{', '.join(module.hinge_names)}]"
