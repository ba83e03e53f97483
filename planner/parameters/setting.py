"""Setting: the description of a parameter that people may set, kept with the field that it sets.

A field of a parameter class that carries a ``Setting`` in its metadata can be set by name on the
command line, in the API and on the page; all of them take label, unit, range and help from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, replace
from typing import Any, Final, Literal, TypeVar

from foldback.planner.parameters.option import described_by

T = TypeVar("T")
Source = Literal["published", "named", "ours"]
Value = float | str | None
"""Value of a setting: a number, one of its words, or None for no limit."""
SETTING_KEY: Final = "setting"


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One number, or one of a few words, that people may set.

    Attributes:
        label: Name on pages, with the symbol of the paper.
        help: One line that explains it.
        unit: Unit as it is shown; empty for a plain number.
        source: ``published`` if the paper gives the value, ``named`` if the paper names the
            parameter without a value, ``ours`` otherwise.
        range: Smallest and largest value, inclusive.
        words: Allowed words, for a setting that is no number.
        whole: True if only whole numbers are allowed.
        optional: True if it may be ``none``, for no limit.
        direct: True if servoing straight to the shape uses it, too.
        name: Name in a text of settings, such as ``damping`` in ``damping=0.05``; that of its field
            if empty, which ``setting_of`` fills in.
    """

    label: str
    help: str
    unit: str = ""
    source: Source = "ours"
    range: tuple[float, float] = (0.0, 0.0)
    words: tuple[str, ...] = ()
    whole: bool = False
    optional: bool = False
    direct: bool = False
    name: str = ""


setting: Final = described_by(Setting, SETTING_KEY)
"""Returns a dataclass field with a default that people may set."""


def shared(default: T, name: str) -> T:
    """Return a dataclass field that the setting of another class sets as well.

    Args:
        default: Value of the field unless it is set.
        name: Name of that setting.
    """
    return field(default=default, metadata={SETTING_KEY: name})


def setting_of(described: Field[Any]) -> Setting | str | None:
    """Return the setting of a field, the name of one that it shares, or None."""
    metadata: Mapping[str, Any] = described.metadata
    found = metadata.get(SETTING_KEY)
    if isinstance(found, Setting):
        return replace(found, name=found.name or described.name)
    return found
