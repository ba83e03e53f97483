"""Picture: the silhouette in it, and the coarse drawing in cells that is most like it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Flags
from foldback.planner.errors import InputError
from foldback.planner.shapes.bridges import parts_of

MIN_TRANSPARENT_SHARE: Final = 0.02
"""Minimum share of the pixels that are transparent for the rest to be the silhouette; with fewer,
the picture's brightness decides."""
MIN_CONTRAST: Final = 0.1
"""Minimum difference of brightness, 0…1, between the two sides of the threshold; a picture with
less is of one colour."""
MIN_PART_SHARE: Final = 0.004
"""Minimum share of the silhouette of a separate part; smaller ones are specks."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """Pixels of a picture.

    Attributes:
        name: Name for people.
        brightness: (rows, columns) brightness on white, 0…255.
        opacity: (rows, columns) opacity, 0…255; None if no pixel is transparent.
        notes: Notes for people on what is left out.
    """

    name: str
    brightness: NDArray[np.uint8]
    opacity: NDArray[np.uint8] | None = None
    notes: tuple[str, ...] = ()

    def silhouette(self, *, threshold: int | None, inside_out: bool) -> Flags:
        """Return the (rows, columns) pixels of the silhouette, without specks, cropped to it.

        Transparent pixels are the background; in a picture without any, what is unlike the rim.

        Args:
            threshold: Brightness in percent that divides the picture; None to choose it.
            inside_out: True to take the background.

        Raises:
            InputError: ``one-colour``, or ``empty``.
        """
        inside = self._inside(threshold)
        if inside_out:
            inside = ~inside
        inside = _without_specks(inside)
        if not inside.any():
            raise InputError(
                "empty",
                "nothing of the picture is left to fold; choose another threshold, or turn the "
                "picture inside out.",
            )
        rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        return inside[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]

    def _inside(self, threshold: int | None) -> Flags:
        if self.opacity is not None and threshold is None:
            inside = self.opacity >= 128
            if float(inside.mean()) <= 1.0 - MIN_TRANSPARENT_SHARE:
                return inside
        level = otsu(self.brightness) if threshold is None else 2.55 * threshold
        dark = self.brightness <= level
        if dark.all() or not dark.any():
            raise _one_colour() if threshold is None else _one_side(threshold, bool(dark.all()))
        contrast = float(self.brightness[~dark].mean() - self.brightness[dark].mean()) / 255.0
        if threshold is None and contrast < MIN_CONTRAST:
            raise _one_colour()
        rim = np.concatenate([dark[0], dark[-1], dark[:, 0], dark[:, -1]])
        return ~dark if float(rim.mean()) > 0.5 else dark


def otsu(brightness: NDArray[np.uint8]) -> float:
    """Return the brightness that divides pixels into the two most different classes (Otsu 1979).

    Of equally good ones, as between pure black and white, it is the middle one.
    """
    counts = np.bincount(brightness.ravel(), minlength=256).astype(np.float64)
    levels = np.arange(256)
    below = np.cumsum(counts)
    sums = np.cumsum(counts * levels)
    above = below[-1] - below
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    between = np.where((below > 0) & (above > 0), between, -1.0)
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-9))
    return float(best[0] + best[-1]) / 2.0


def _without_specks(inside: Flags) -> Flags:
    """Return the silhouette without parts that are too small to matter."""
    numbers, sizes = parts_of(inside)
    if len(sizes) < 2:
        return inside
    is_part = sizes >= max(1.0, MIN_PART_SHARE * float(sizes.sum()))
    return np.concatenate([[False], is_part])[numbers]


def _one_colour() -> InputError:
    return InputError(
        "one-colour",
        "the picture is of nearly one colour, expected a figure on a background that is lighter, "
        "darker or transparent; raise the contrast of the picture.",
    )


def _one_side(threshold: int, is_dark: bool) -> InputError:
    side, remedy = ("darker", "lower") if is_dark else ("brighter", "higher")
    return InputError(
        "one-colour",
        f"all of the picture is {side} than the threshold of {threshold} %, expected a figure and "
        f"a background; use a {remedy} threshold, or none.",
    )
