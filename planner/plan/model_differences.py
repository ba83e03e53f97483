"""Model differences: where a robot model is not the one that a plan makes, by element.

Both texts are compiled by MuJoCo and compared number by number, so that neither spaces nor the
order of attributes count, and all that a simulation would notice does.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from foldback.planner.errors import InputError
from foldback.planner.simulation.lazy_mujoco import mujoco

ELEMENTS_BY_PREFIX: Final = {
    "body": ("body", "nbody"),
    "jnt": ("joint", "njnt"),
    "geom": ("geom", "ngeom"),
    "site": ("site", "nsite"),
    "key": ("key", "nkey"),
    "exclude": ("exclude", "nexclude"),
    "eq": ("equality", "neq"),
}
"""Kind of element, and the field with the number of such elements, for the first word of an array's
name in a compiled MuJoCo model; messages about differences name elements by it."""
UNNAMED_ELEMENTS: Final = ("exclude", "equality")
"""Kinds of elements of a MuJoCo model that messages about differences name by their number, as they
have no names."""
IGNORED_PREFIXES: Final = ("_", "name", "nnames", "text")
"""Beginnings of the names of fields that are left out when two compiled MuJoCo models are compared,
as they only restate the names of elements."""


def compiled(xml: str) -> Any:
    """Return the compiled model of an MJCF text.

    Raises:
        InputError: ``not-a-model``.
    """
    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise InputError("not-a-model", f"MuJoCo cannot load the model: {error}") from error


def model_differences(text: str, expected: str) -> Iterator[str]:
    """Yield the differences between a model and the expected one; nothing if they are equal.

    Args:
        text, expected: Both models as MJCF.

    Raises:
        InputError: ``not-a-model``.
    """
    if text == expected:
        return
    model, reference = compiled(text), compiled(expected)
    if model.names != reference.names:
        yield _renamed(model, reference)
    for part, of, reference_part in (("", model, reference), ("option ", model.opt, reference.opt)):
        for name in dir(reference if not part else reference.opt):
            value, expected_value = getattr(of, name, None), getattr(reference_part, name, None)
            if isinstance(expected_value, np.ndarray | int | float) and not name.startswith(
                IGNORED_PREFIXES
            ):
                yield from _difference(model, part, name, value, expected_value)


def _difference(model: Any, part: str, name: str, value: Any, expected_value: Any) -> Iterator[str]:
    actual, expected = np.asarray(value), np.asarray(expected_value)
    if actual.shape != expected.shape:
        yield f"{part}{name}: got the shape {actual.shape}, expected {expected.shape}"
        return
    if actual.dtype.kind not in "fiub":
        return
    # MJCF files hold six significant digits.
    off = ~np.isclose(actual, expected, rtol=5e-7, atol=2e-7, equal_nan=True)
    if not off.any():
        return
    place = tuple(int(k) for k in np.argwhere(off)[0])
    element = ""
    kind, count = ELEMENTS_BY_PREFIX.get(name.partition("_")[0], ("", ""))
    if kind and place and len(actual) == getattr(model, count):
        called = "" if kind in UNNAMED_ELEMENTS else getattr(model, kind)(place[0]).name
        element = f" of {kind} {called or place[0]}"
    values = f"got {actual[place].item():.9g}, expected {expected[place].item():.9g}"
    yield f"{part}{name}{element}: {values}"


def _renamed(model: Any, reference: Any) -> str:
    actual_names, expected_names = (bytes(model.names).split(b"\0") for model in (model, reference))
    for actual_name, expected in zip(actual_names, expected_names, strict=False):
        if actual_name != expected:
            return (
                f"names: got {actual_name.decode(errors='replace')}, expected {expected.decode()}"
            )
    return f"got {len(actual_names)} names, expected {len(expected_names)}"
