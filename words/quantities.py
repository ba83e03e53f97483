"""Quantities: numbers with their units, and parameters in words, as pages show them."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import Any, Final, cast

from foldback.planner.parameters.parameters import PRESET_CHOICES, STRATEGY_CHOICES
from foldback.planner.parameters.setting import Description, descriptions

SIGNIFICANT_DIGITS: Final = 3
"""Default number of significant digits to which displayed numbers are rounded."""
NO_BREAK_SPACE: Final = "\u00a0"
"""Space between a number and its unit, at which browsers must not break the line."""
SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SI_PREFIXES: Final = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k"}
"""SI prefixes of displayed quantities by power of ten; ``SI_PREFIXES`` in ``lib/text.js`` must be
the same."""
SI_UNITS: Final = ("N·m", "rad", "rad/s")
"""Units that pages display with an SI prefix, such as mN·m; quantities in other units get a power
of ten."""
STRATEGY_LABELS: Final = {
    **{name: choice.label for name, choice in STRATEGY_CHOICES.items()},
    "smoothed": "A smoothed version of a recorded motion",
    "softened": "A slightly smoothed version of a recorded motion",
    "recorded": "A recorded motion with new timing",
}
PRESET_LABELS: Final = {
    name: choice.label.partition(" (")[0] for name, choice in PRESET_CHOICES.items()
}
"""Labels of presets, without the advice that a form adds in brackets."""
CONTROLLER_LABELS: Final = {
    "robot": "Servos with feed-forward",
    "computed-torque": "Computed torque (an ideal robot)",
    "paper": "Threshold rule from the paper",
    "direct": "Joints turned directly",
}


def number(value: float, digits: int = SIGNIFICANT_DIGITS) -> str:
    """Return a number as text, with ``digits`` significant digits: 0.00382, 30000, 1.3×10⁻¹².

    ``number`` in ``lib/text.js`` gives the same texts.
    """
    if value == 0:
        return "0"
    if isinstance(value, int):
        return str(value)
    rounded = _rounded(value, digits)
    power = rounded.adjusted()
    if -4 <= power < digits:
        return _plain(rounded)
    if 1.0 <= abs(value) < 1e6:
        return _plain(Decimal(value).quantize(Decimal(1), ROUND_HALF_UP))
    return f"{_plain(rounded.scaleb(-power))}×10{str(power).translate(SUPERSCRIPTS)}"


def si(value: float, unit: str, digits: int = SIGNIFICANT_DIGITS) -> str:
    """Return a quantity with an SI prefix: ``34 µN·m``, ``0 rad``, ``< 1 pN·m``.

    ``si`` in ``lib/text.js`` gives the same texts.
    """
    if value == 0.0:
        return f"0 {unit}"
    rounded = _rounded(value, digits)
    power = 3 * (rounded.adjusted() // 3)
    if power < (least_power := min(SI_PREFIXES)):
        return f"< 1 {SI_PREFIXES[least_power]}{unit}"
    power = min(power, max(SI_PREFIXES))
    return f"{_plain(rounded.scaleb(-power))} {SI_PREFIXES[power]}{unit}"


def _rounded(value: float, digits: int) -> Decimal:
    """Round a value to ``digits`` significant digits; ties go away from zero, as in scripts."""
    return Context(prec=digits, rounding=ROUND_HALF_UP).create_decimal(Decimal(value))


def _plain(value: Decimal) -> str:
    """Return a number as text, without exponent and trailing zeros, and with a minus sign (−)."""
    text = f"{value:f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")


def quantity(value: object, unit: str = "", digits: int = SIGNIFICANT_DIGITS) -> str | None:
    """Return a number, a range of two, or a word, with its unit; None for a missing value."""
    if value is None or value == "":
        return None
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        parts = list(cast("list[object] | tuple[object, ...]", value))
        with_prefix = unit in SI_UNITS
        texts = [str(quantity(part, unit if with_prefix else "", digits)) for part in parts]
        text = (" to " if len(texts) == 2 else ", ").join(texts)
        return text if with_prefix else f"{text} {unit}".rstrip()
    if isinstance(value, int | float):
        return (
            si(value, unit, digits)
            if unit in SI_UNITS
            else f"{number(value, digits)} {unit}".rstrip()
        )
    return f"{value} {unit}".rstrip()


def spacings(pitches: float, digits: int = SIGNIFICANT_DIGITS) -> str:
    """Return a length in words: ``4.3 % of the spacing``, ``1.16 times the spacing``.

    The spacing is the distance between the centres of neighbouring modules: one pitch.
    """
    if abs(pitches) < 1.0:
        return f"{number(100.0 * pitches, digits)} % of the spacing"
    pitches_text = number(pitches, digits)
    return "one spacing" if pitches_text == "1" else f"{pitches_text} times the spacing"


def length_m(value: object) -> str | None:
    """Return a length in metres, or in millimetres if it is short."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return quantity(value * 1000, "mm") if abs(value) < 1 else quantity(value, "m")


def parameters(values: Mapping[str, object], kind: type[Any]) -> list[tuple[str, str | None]]:
    """Return parameters as labels and values, in their order.

    Args:
        values: Values by the names of fields; those of another version may have no description.
        kind: Class of the parameters.
    """
    labels = descriptions(kind)
    return [
        _parameter(labels.get(name) or Description(sentence(name.replace("_", " "))), name, value)
        for name, value in values.items()
    ]


def _parameter(described: Description, name: str, value: object) -> tuple[str, str | None]:
    if name == "controller":
        value = CONTROLLER_LABELS.get(str(value), value)
    return described.label, quantity(value, described.unit)


def unbroken(text: str) -> str:
    """Return a text in which lines do not break between a number and %."""
    return text.replace(" %", f"{NO_BREAK_SPACE}%")


def sentence(text: str) -> str:
    """Return a text with its first letter in upper case."""
    return text[:1].upper() + text[1:]
