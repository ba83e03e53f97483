"""Palette: the colours of modules, and their conversion for viser's mesh instances.

Each colour has one meaning: red is a joint error, blue a selected module, orange a module at which
a fold stalled, grey an error that was not recorded, although that of other modules was.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.module import Module

Array = NDArray[np.float64]
Rgb = tuple[int, int, int]

NO_ERROR_RGB: Final[Rgb] = (206, 208, 212)
"""Colour of a module whose joint angle has no error, sRGB."""
UNKNOWN_ERROR_RGB: Final[Rgb] = (168, 172, 179)
"""Colour of a module whose joint error was not recorded, sRGB."""
MAX_ERROR_RGB: Final[Rgb] = (208, 10, 18)
"""Colour of a module whose joint error is at the upper end of the colour scale or above, sRGB."""
SELECTED_RGB: Final[Rgb] = (10, 84, 240)
STALLED_RGB: Final[Rgb] = (255, 140, 0)
"""Colour that marks the modules at which a failed fold stalled, sRGB."""
FIRST_MODULE_RGB: Final[Rgb] = (255, 255, 255)
LAST_MODULE_RGB: Final[Rgb] = (38, 42, 50)

CIVIDIS: Final = (
    *("00224e", "123570", "3b496c", "575d6d", "707173"),
    *("8a8678", "a59c74", "c3b369", "e1cc55", "fee838"),
)
"""Ten equidistant colours of the colour map cividis (Nuñez et al. 2018), as hexadecimal sRGB; it
looks the same with red-green colour blindness. It colours modules by their position along the
chain."""

MIN_ERROR_SCALE_RAD: Final = 1e-5
"""Smallest upper end of the colour scale of joint errors, in rad. With a smaller value the rounding
errors of a perfect simulation would be drawn in red."""
RAMP_COLOURS: Final = 256
"""Number of colours of the scale that shows joint errors."""


def linear_from_srgb(srgb: Array) -> Array:
    """Convert sRGB values (…) in 0 to 1 to linear light in 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: Array) -> Array:
    """Convert linear light (…) in 0 to 1 to sRGB values in 0 to 1."""
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def instance_colours(srgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert (N, 3) sRGB bytes to the linear bytes that viser reads for mesh instances."""
    return _LINEAR_BYTE[srgb]


def error_ramp(steps: int = RAMP_COLOURS) -> NDArray[np.uint8]:
    """Return (steps, 3) sRGB bytes from no error to the largest, evenly spaced in linear light."""
    start, end = (linear_from_srgb(np.array(c) / 255.0) for c in (NO_ERROR_RGB, MAX_ERROR_RGB))
    t = np.linspace(0.0, 1.0, steps)[:, None]
    return np.rint(srgb_from_linear(start + (end - start) * t) * 255.0).astype(np.uint8)


def ramp_colours(shares: Array) -> NDArray[np.uint8]:
    """Convert (n,) positions along a chain, 0 to 1, to (n, 3) sRGB bytes of cividis."""
    stops = np.array([[int(c[k : k + 2], 16) for k in (0, 2, 4)] for c in CIVIDIS], np.float64)
    at = np.linspace(0.0, 1.0, len(stops))
    return np.rint(np.column_stack([np.interp(shares, at, stops[:, k]) for k in range(3)])).astype(
        np.uint8
    )


def own_colours(module: Module, modules: int) -> NDArray[np.uint8]:
    """Return (n, 3) sRGB bytes of modules that no other colour says anything about.

    They are the colours that the module's file names, in turn, or a light grey.
    """
    colours = [bytes.fromhex(colour.removeprefix("#")) for colour in module.colours]
    return np.resize(
        np.array([[*colour] for colour in colours] or NO_ERROR_RGB, np.uint8), (modules, 3)
    )


def error_scale(largest_rad: float) -> float:
    """Return the end of the colour scale in rad: the largest error, unless that is rounding."""
    return (
        max(largest_rad, MIN_ERROR_SCALE_RAD) if np.isfinite(largest_rad) else MIN_ERROR_SCALE_RAD
    )


def module_errors(joint_error_rad: Array, module: Module, modules: int) -> Array:
    """Return the error of each module: the largest of its joint's hinges.

    Args:
        joint_error_rad: (…, J) errors; NaN where none is recorded.
        module: Kind of the chain's modules.
        modules: Number of modules n.

    Returns:
        (…, n) non-negative errors in rad; a module without a joint has that of the nearest joint.
    """
    hinges = (*joint_error_rad.shape[:-1], -1, module.hinges_per_joint)
    by_joint = np.abs(joint_error_rad).reshape(hinges).max(axis=-1)
    carried = np.clip(module.joint_after(np.arange(modules)), 0, by_joint.shape[-1] - 1)
    return by_joint[..., carried]


def error_colours(errors_rad: Array, scale_rad: float) -> NDArray[np.uint8]:
    """Convert (n,) errors to (n, 3) sRGB bytes: redder if larger, grey if unknown.

    If no error is known, as while the chain unfolds, the colours show the positions in the chain.
    """
    is_known = np.isfinite(errors_rad)
    if not is_known.any():
        return ramp_colours(np.linspace(0.0, 1.0, len(errors_rad)))
    share = np.clip(np.where(is_known, errors_rad, 0.0) / scale_rad, 0.0, 1.0)
    colours = _RAMP[np.rint(share * (RAMP_COLOURS - 1)).astype(np.int64)]
    colours[~is_known] = UNKNOWN_ERROR_RGB
    return colours


_LINEAR_BYTE: Final = np.rint(linear_from_srgb(np.arange(256) / 255.0) * 255.0).astype(np.uint8)
_RAMP: Final = error_ramp()
