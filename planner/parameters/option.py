"""Option: the description of one thing that can be requested, kept with the field that holds it.

The form of the API, the options of the command line, the types of the Python client, the controls
of the preview page and the table in docs/api.md are made of these descriptions.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from functools import cache
from hashlib import sha256
from types import NoneType
from typing import (
    TYPE_CHECKING,
    Any,
    Concatenate,
    Final,
    Literal,
    ParamSpec,
    TypeVar,
    get_args,
    get_type_hints,
)

from foldback.planner.errors import InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
Texts = ParamSpec("Texts")
OPTION_KEY: Final = "option"
OPTIONS_KEY_CHARS: Final = 24
"""Number of hexadecimal digits of the key under which results computed with certain options are
cached: the beginning of the SHA-256 of these options, 96 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """One value of an option that has a few.

    Attributes:
        label: Text on pages.
        note: Explanation in a few words, for the command line.
        hint: Explanation as a sentence, for pages.
    """

    label: str
    note: str = ""
    hint: str = ""


Choices = Mapping[str, Choice]


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One thing that can be requested.

    Attributes:
        title: Noun phrase that names it, without a full stop.
        noun: Name in error messages; that of the field if empty.
        help: Explanation for the API and the docs; the title if None.
        label: Label of its control on the preview page; empty if there is none.
        choices: Allowed values by name, in their order; empty if it has others.
        range: Smallest and largest number, inclusive; None for other values.
        unit: Unit of the number, in error messages.
        pattern: Regular expression of the texts that ``parse`` reads.
        max_chars: Maximum number of characters of a text.
        metavar: Name of the value on the command line; that of its type if empty.
        parse: Reads the value from a text; None for the constructor of its type.
        name, kind, default, optional: Name, type and default of the field, and True if the value
            may be None. ``options_of`` fills them in.
    """

    title: str
    noun: str = ""
    help: str | None = None
    label: str = ""
    choices: Choices = field(default_factory=dict[str, Choice])
    range: tuple[float, float] | None = None
    unit: str = ""
    pattern: str | None = None
    max_chars: int | None = None
    metavar: str = ""
    parse: Callable[[str], Any] | None = None
    name: str = ""
    kind: Any = str
    default: Any = None
    optional: bool = False

    @property
    def meaning(self) -> str:
        """The explanation for the API and the docs."""
        return f"{self.title}." if self.help is None else self.help

    @property
    def line(self) -> str:
        """The explanation for the command line: the title with the choices."""
        if not self.choices:
            return f"{self.title}."
        *other_choices, last = (
            f"{name} ({choice.note})" if choice.note else name
            for name, choice in self.choices.items()
        )
        return f"{self.title}: {', '.join(other_choices)} or {last}."

    @property
    def annotation(self) -> Any:
        """The type of its values in a form: one of the choices, a text that is parsed, or as is."""
        kind: Any = self.kind if self.parse is None else str
        if self.choices:
            kind = Literal[tuple(self.choices)]
        return kind | None if self.optional else kind

    def read(self, value: Any) -> Any:
        """Return the value of a text; other values as they are.

        Raises:
            InputError: ``bad-…``, if it cannot be read.
        """
        parse = self.parse or (self.kind if self.kind in (int, float) else None)
        if parse is None or not isinstance(value, str):
            return value
        try:
            return parse(value)
        except InputError as error:
            raise error.changed(where=self.name) from None
        except ValueError:
            raise self._out_of_range(repr(value[:40])) from None

    def check(self, value: Any) -> None:
        """Refuse a value that is none of the choices, or out of range.

        Raises:
            InputError: ``unknown-…`` or ``bad-…``, with the option in ``where``.
        """
        if value is None:
            return
        if self.choices and value not in self.choices:
            raise InputError(
                f"unknown-{self.name.replace('_', '-')}",
                f"got the {self.noun or self.name} {value!r}, expected one of: "
                f"{', '.join(self.choices)}.",
                where=self.name,
            )
        if self.range is not None and not self.range[0] <= value <= self.range[1]:
            raise self._out_of_range(f"{value:g}" if self.kind is float else str(value))

    def _out_of_range(self, value: str) -> InputError:
        low, high = self.range or (0, 0)
        prefix = "a whole number from " if self.kind is int else ""
        limits = f"{low} to {high}" if self.kind is int else f"{low:g} to {high:g}"
        expected = f"{prefix}{limits} {self.unit}".rstrip()
        return InputError(
            f"bad-{self.name.replace('_', '-')}",
            f"got the {self.noun or self.name} {value}, expected {expected}.",
            where=self.name,
        )


def described_by(
    description: Callable[Texts, object], key: str
) -> Callable[Concatenate[T, Texts], T]:
    """Return a function that makes a dataclass field with a default and a description.

    Args:
        description: Class of the description; the function takes its arguments after the default.
        key: Name of the description in the field's metadata.
    """

    def described(default: T, *args: Texts.args, **texts: Texts.kwargs) -> T:
        return field(default=default, metadata={key: description(*args, **texts)})

    return described


option: Final = described_by(Option, OPTION_KEY)
"""Returns a dataclass field with a default that can be requested otherwise."""


@cache
def key_of_options(options: DataclassInstance) -> str:
    """Return a key that is the same for the same values of all fields."""
    text = json.dumps(asdict(options), sort_keys=True)
    return sha256(text.encode()).hexdigest()[:OPTIONS_KEY_CHARS]


def options_of(request: type[Any]) -> dict[str, Option]:
    """Return the options of a class of requests by name: its own, then those that it inherits."""
    hints = get_type_hints(request)
    options: dict[str, Option] = {}
    for attribute in sorted(fields(request), key=lambda f: f.name not in request.__annotations__):
        described: Option | None = attribute.metadata.get(OPTION_KEY)
        if described is None:
            continue
        kinds = get_args(hints[attribute.name])
        optional = NoneType in kinds
        options[attribute.name] = replace(
            described,
            name=attribute.name,
            kind=next(kind for kind in kinds if kind is not NoneType)
            if optional
            else str
            if described.choices
            else hints[attribute.name],
            default=None if attribute.default is MISSING else attribute.default,
            optional=optional,
        )
    return options
