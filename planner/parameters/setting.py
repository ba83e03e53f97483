"""Descriptions of parameters, each kept with its field: label and unit, and more for settings.

A field of a parameter class whose description is a ``Setting`` can be set by name on the command
line, in the API and on the page of a preview. All of them take label, unit, range and help from
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, Final, Literal, TypeVar

from foldback.planner.parameters.option import described_by

T = TypeVar("T")
Source = Literal["published", "named", "ours"]
Value = float | str | None
"""Value of a setting: a number, one of its words, or None for no limit."""
DESCRIPTION_KEY: Final = "description"


@dataclass(frozen=True, slots=True)
class Description:
    """Description of a parameter, as pages show it.

    Attributes:
        label: Name on pages, with the symbol of the paper.
        unit: Unit as it is shown; empty for a plain number.
    """

    label: str
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting(Description):
    """One number, or one of a few words, that people may set.

    Attributes:
        help: One line that explains it.
        source: ``published`` if the paper gives the value, ``named`` if the paper names the
            parameter without a value, ``ours`` otherwise.
        range: Smallest and largest value, inclusive.
        words: Allowed words, for a setting that is no number.
        is_whole: True if only whole numbers are allowed.
        optional: True if it may be ``none``: for no limit, or as its help says.
        is_own: True if foldback's own method uses it, too, and not the published one alone.
        direct: True if servoing straight to the shape uses it, too.
        name: Name of its field, which ``descriptions`` fills in: the one in requests, in plans and
            in texts of settings such as ``damping=0.05``.
    """

    help: str
    source: Source = "ours"
    range: tuple[float, float] = (0.0, 0.0)
    words: tuple[str, ...] = ()
    is_whole: bool = False
    optional: bool = False
    is_own: bool = False
    direct: bool = False
    name: str = ""


described: Final = described_by(Description, DESCRIPTION_KEY)
"""Returns a dataclass field with a default that people may not set."""
setting: Final = described_by(Setting, DESCRIPTION_KEY)
"""Returns a dataclass field with a default that people may set."""


def shared(default: T, kind: type[Any]) -> T:
    """Return a dataclass field with the description of the field of that name in another class.

    A setting changes all fields that share its description.

    Args:
        default: Value of the field.
        kind: The other class.
    """
    return field(default=default, metadata={DESCRIPTION_KEY: kind})


@cache
def descriptions(kind: type[Any]) -> Mapping[str, Description]:
    """Return the descriptions of a class of parameters by the names of its fields."""
    return {
        parameter.name: _description(parameter.name, parameter.metadata[DESCRIPTION_KEY])
        for parameter in fields(kind)
        if DESCRIPTION_KEY in parameter.metadata
    }


def _description(name: str, described: Description | type[Any]) -> Description:
    if isinstance(described, type):
        return descriptions(described)[name]
    return replace(described, name=name) if isinstance(described, Setting) else described
