"""Startup errors: messages if a process of the service cannot start, or not as configured."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from pydantic import ValidationError

from foldback.server.settings import VARIABLE_PREFIX, Settings, unknown_names, unknown_words

EXPECTED_WORDS: Final = {
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "bool_parsing": "true or false",
    "string_type": "names separated by commas",
    "tuple_type": "names separated by commas",
    "literal_error": "{expected}",
    "greater_than_equal": "at least {ge}",
    "greater_than": "more than {gt}",
    "less_than_equal": "at most {le}",
}
"""Texts for the expected value in error messages about settings, by pydantic's type of error."""
REMEDY: Final = "Correct the setting, or unset it; docs/operations.md lists all settings."
MAX_QUOTED_CHARACTERS: Final = 60
"""Maximum length of a setting's value that an error message quotes, in characters; the rest is cut
off."""


def settings_of(**fields: Any) -> Settings:
    """Return the settings of the environment, with those given on the command line.

    Invalid settings end the program with a message of one line and the exit code 1.
    """
    try:
        return Settings(**{name: value for name, value in fields.items() if value is not None})
    except ValidationError as error:
        print(f"{settings_words(error)}. {REMEDY}", file=sys.stderr)
        raise SystemExit(1) from None


def settings_words(error: ValidationError) -> str:
    """Return the errors of the settings: the values found and expected."""
    wrong = [
        f"{VARIABLE_PREFIX}{str(fault['loc'][0]).upper()}: {_fault(fault)}"
        for fault in error.errors()
    ]
    return "; ".join(wrong)


def _fault(fault: Mapping[str, Any]) -> str:
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"]).removesuffix(".")
    expected = str(EXPECTED_WORDS.get(fault["type"], fault["msg"])).format(**fault.get("ctx", {}))
    input_text = str(fault["input"])
    if len(input_text) > MAX_QUOTED_CHARACTERS:
        input_text = input_text[:MAX_QUOTED_CHARACTERS] + "…"
    return f"got {input_text!r}, expected {expected}"


def warn_of_unknown_names(log: logging.Logger) -> None:
    """Log warnings about variables that resemble settings but are none."""
    for name, nearest in unknown_names(os.environ).items():
        log.warning("%s", unknown_words(name, nearest))


@contextmanager
def starting(service: str) -> Generator[None]:
    """Turn a missing resource into an error on one line and the exit code 1.

    Args:
        service: Name of the starting program, for the message.
    """
    # Imported here, because commands without a database use this module as well.
    from sqlalchemy.exc import DBAPIError

    from foldback.server.store.object_store import StorageError
    from foldback.server.store.schema import PoolerError
    from foldback.server.store.schema_version import NewerSchemaError

    try:
        yield
    except (NewerSchemaError, PoolerError) as error:
        reason = str(error)
    except StorageError as error:
        reason = f"{error}."
    except DBAPIError as error:
        line = str(error.orig).strip().partition("\n")[0]
        reason = f"the database is not available ({line})."
    except OSError as error:
        reason = f"{error.filename or 'the data directory'} cannot be used ({error.strerror})."
    else:
        return
    print(
        f"The {service} does not start: {reason} Run `foldback doctor` for details.",
        file=sys.stderr,
    )
    raise SystemExit(1)
