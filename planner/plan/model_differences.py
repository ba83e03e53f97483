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
    here, there = compiled(text), compiled(expected)
    if here.names != there.names:
        yield _renamed(here, there)
    for part, of, other in (("", here, there), ("option ", here.opt, there.opt)):
        for name in dir(there if not part else there.opt):
            mine, theirs = getattr(of, name, None), getattr(other, name, None)
            if isinstance(theirs, np.ndarray | int | float) and not name.startswith(
                IGNORED_PREFIXES
            ):
                yield from _difference(here, part, name, mine, theirs)


def _difference(model: Any, part: str, name: str, mine: Any, theirs: Any) -> Iterator[str]:
    got, expected = np.asarray(mine), np.asarray(theirs)
    if got.shape != expected.shape:
        yield f"{part}{name}: got the shape {got.shape}, expected {expected.shape}"
        return
    if got.dtype.kind not in "fiub":
        return
    # MJCF files hold six significant digits.
    off = ~np.isclose(got, expected, rtol=5e-7, atol=2e-7, equal_nan=True)
    if not off.any():
        return
    place = tuple(int(k) for k in np.argwhere(off)[0])
    where = ""
    kind, count = ELEMENTS_BY_PREFIX.get(name.partition("_")[0], ("", ""))
    if kind and place and len(got) == getattr(model, count):
        called = "" if kind in UNNAMED_ELEMENTS else getattr(model, kind)(place[0]).name
        where = f" of {kind} {called or place[0]}"
    yield f"{part}{name}{where}: got {got[place].item():.9g}, expected {expected[place].item():.9g}"


def _renamed(here: Any, there: Any) -> str:
    mine, theirs = (bytes(model.names).split(b"\0") for model in (here, there))
    for got, expected in zip(mine, theirs, strict=False):
        if got != expected:
            return f"names: got {got.decode(errors='replace')}, expected {expected.decode()}"
    return f"got {len(mine)} names, expected {len(theirs)}"
