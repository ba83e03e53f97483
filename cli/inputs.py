"""Inputs of commands: files, examples and plans, and refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer
from rich.console import Console

from foldback.cli.exit_statuses import INVALID_INPUT
from foldback.cli.typed_codes import typed_code, typed_snake, typed_snake_cube, typed_word
from foldback.planner.errors import InputError
from foldback.planner.readers.angle_strings import HEADING
from foldback.planner.readers.gallery import Gallery
from foldback.planner.readers.limits import megabytes
from foldback.planner.storage.files import MAX_FILE_BYTES

if TYPE_CHECKING:
    from foldback.planner.plan.plan import Plan


def read_input(
    shape: str | None,
    angles: str | None = None,
    module: str | None = None,
    *,
    snake: str | None = None,
    snake_cube: str | None = None,
    word: str | None = None,
) -> tuple[bytes, str]:
    """Return the bytes and name of a file, of the example of that name, or of typed text.

    Args:
        shape: File, or name of an example.
        angles: Instead of it, angles of the hinges.
        module: Module file, or name of a module, of a chain that has none; None for others.
        snake: Instead of it, code or name of a figure of a Rubik's snake.
        snake_cube: Instead of it, pieces or name of a snake cube.
        word: Instead of it, letters of a word.

    Raises:
        InputError: If none or several are given, or a file is too large or cannot be used.
    """
    typed = {"--angles": angles, "--snake": snake, "--snake-cube": snake_cube, "--word": word}
    names = [name for name, value in {"INPUT": shape, **typed}.items() if value is not None]
    if len(names) != 1:
        raise InputError(
            "no-input",
            f"got {' and '.join(names) or 'nothing to fold'}, expected one of INPUT, "
            f"{', '.join(typed)}.",
        )
    if snake is not None:
        return typed_snake(snake)
    if snake_cube is not None:
        return typed_snake_cube(snake_cube)
    if word is not None:
        return typed_word(word)
    if module is None:
        return _read_input(shape, angles)
    from foldback.planner.readers.own_module import built_in_or_file, chain_of_angles, with_module

    own = built_in_or_file(module, bytes_of(Path(module)) if Path(module).exists() else None)
    if angles is not None and shape is None:
        return chain_of_angles(angles, own), "typed.json"
    data, name = _read_input(shape, angles)
    return with_module(data, own), name


def _read_input(shape: str | None, angles: str | None) -> tuple[bytes, str]:
    """Return the bytes and name of an input whose modules are not given apart from it."""
    if shape is None:
        return f"{HEADING}\n{angles}".encode(), "typed.txt"
    path = Path(shape)
    if not path.exists():
        if (example := Gallery().shape(shape)) is not None:
            return example.data, example.filename
        if (code := typed_code(shape)) is not None:
            return code
    return bytes_of(path), path.name


def bytes_of(path: Path) -> bytes:
    """Return the bytes of a file.

    Raises:
        InputError: If it cannot be read, or is too large.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(
                "too-large",
                f"got {megabytes(path.stat().st_size)}, expected at most "
                f"{megabytes(MAX_FILE_BYTES)}.",
                where=path.name,
            )
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            "no-file",
            f"the file cannot be read ({error.strerror}); expected a file, or the "
            f"name of one of {Gallery().nearest(str(path))}.",
            where=str(path),
        ) from error


def read_plan(directory: Path) -> Plan:
    """Return the plan in a fold's directory.

    Raises:
        InputError: If there is none, it cannot be read, or other files are of another fold.
    """
    from foldback.planner.verification.stored_fold import read_fold  # imports the whole planner

    return read_fold(directory)


def refuse(error: InputError, as_json: bool) -> NoReturn:
    """Print the error of the input and exit with 2."""
    if as_json:
        problem = {
            "code": error.code,
            "values": error.values,
            "detail": error.detail,
            "where": error.where,
        }
        print(json.dumps({"status": "invalid", "error": problem}), flush=True)
    else:
        Console(stderr=True, soft_wrap=True, highlight=False).print(error.message, markup=False)
    raise typer.Exit(INVALID_INPUT)
