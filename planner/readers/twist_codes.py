"""Codes of Rubik's snakes and snake cubes as text, in the notations of those who collect them.

A text may name its notation, as in ``digits: 1133…``, or only say that it is a code of a ``snake``
or of a ``snake-cube``. Names and examples stand in ``EXAMPLES``. Without a name of a notation it
follows from the text if only one fits; otherwise the text is refused, because a code that is read
in a wrong notation is another figure.
"""

from __future__ import annotations

import re
from typing import Final, Literal

from foldback.planner.errors import InputError
from foldback.planner.readers.angle_strings import MAX_COLUMNS
from foldback.planner.readers.limits import MAX_CELLS, quote, too_many
from foldback.planner.twist_chains.cube_sequence import NOTATIONS as CUBE_NOTATIONS
from foldback.planner.twist_chains.cube_sequence import CubeSequence, sequence_of_legs
from foldback.planner.twist_chains.figures import snake_figure
from foldback.planner.twist_chains.prism_lattice import check_overlap, closing_digit
from foldback.planner.twist_chains.snake_code import LETTERS, SnakeCode
from foldback.planner.twist_chains.snake_code import NOTATIONS as SNAKE_NOTATIONS

Family = Literal["snake", "snake-cube"]
EXAMPLES: Final = {
    "digits": "digits: 0132",
    "fiore": "fiore: DLRU",
    "glsnake": "glsnake: ZRLP",
    "wolter": "wolter: 2L1-2R3-3L2",
    "cube": "cube: 0011010",
    "letters": "letters: ESCCSCE",
    "runs": "runs: 3,2,3,2",
    "legs": "legs: 2,1,2,1",
    "run-and-legs": "run-and-legs: 3,1,2,1",
}
"""Names of the notations, each with a short code."""
FAMILY_NAMES: Final[dict[str, tuple[str, ...]]] = {
    "snake": SNAKE_NOTATIONS,
    "snake-cube": CUBE_NOTATIONS,
}
"""Names of the notations of snakes and of snake cubes. A text may have the name of the family."""
SNAKE_STEP: Final = 12
"""Snakes are sold with 24, 36, 48, 60 or 72 prisms: multiples of this number, from 24 on. A list of
so many digits has one for the joint between the last prism and the first, which many collections
store without a meaning."""
MIN_SNAKE_PRISMS: Final = 24
"""Number of prisms of the usual snake."""
MIN_CODE_LETTERS: Final = 5
"""Minimum number of letters or digits of a text that is recognised as a code without a name of its
notation."""
MAX_CUBE_SIDE: Final = 16
"""Maximum side of a cube whose number of pieces tells the notation of a list of runs or legs."""
MAX_CODE_CHARACTERS: Final = 8 * MAX_CELLS
"""Maximum length of a text with a code, in characters."""

_NAMED: Final = re.compile(r"\s*(?:(\d{1,6})\s+prisms\s*)?(?:([a-z-]+)\s*)?:(.*)", re.S | re.I)
_BETWEEN: Final = r"[\s,;|–—-]*"
_CLOSING: Final = re.compile(r"(.*?)[\[(]\s*([0-3A-Za-z])\s*[\])]\s*", re.S)
_WOLTER_STEP: Final = re.compile(r"(\d{1,6})([LR])([0-3])", re.I)
_WOLTER: Final = re.compile(rf"(?:\d{{1,6}}[LR][0-3]{_BETWEEN})+", re.I)
_GLSNAKE_WORDS: Final = {"ZERO": "Z", "RIGHT": "R", "PIN": "P", "LEFT": "L"}
_GLSNAKE_WORD: Final = re.compile("|".join(_GLSNAKE_WORDS), re.I)
_NUMBER: Final = re.compile(r"\d{1,6}")
_NUMBERS: Final = re.compile(r"\d{1,6}(?:[\s,;|–—-]+\d{1,6})*")
_SEPARATORS: Final = re.compile(r"[\s,;|–—-]+")
_SPACED: Final = re.compile(r"[^\S\n]+|[,;|]")


def read_twist_code(
    text: str, family: str | None = None, *, max_modules: int = MAX_CELLS
) -> SnakeCode | CubeSequence:
    """Read a code of a Rubik's snake or a sequence of a snake cube.

    Args:
        text: The code, with or without the name of its notation before a colon; of a snake also
            the name of a known figure.
        family: Read only notations of snakes, or only those of snake cubes; None for both.
        max_modules: Maximum number of prisms or cubes.

    Returns:
        The code of a figure in which no prisms overlap, or the sequence of pieces.

    Raises:
        InputError: ``ambiguous-code`` if several notations fit; ``bad-code`` if none does, or the
            named one does not; ``closing-digit`` if the digit in brackets does not fit the figure;
            ``overlap`` with the numbers of two prisms that lie in one another; ``too-many-cells``.
    """
    if len(text) > MAX_CODE_CHARACTERS:
        raise too_many(len(text), MAX_CODE_CHARACTERS, "characters")
    prisms, name, body = _split(text)
    if family is None and name in FAMILY_NAMES:
        family, name = name, None
    allowed = FAMILY_NAMES[family] if family else (*SNAKE_NOTATIONS, *CUBE_NOTATIONS)
    if name is not None and name not in allowed:
        raise InputError(
            "bad-code", f"got the notation {quote(name)!r}, expected one of: {', '.join(allowed)}."
        )
    if family == "snake" and name is None and (figure := snake_figure(body.strip())):
        return figure.code
    fitting = notations_of(body, allowed) if name is None else (name,)
    if len(fitting) == 0:
        raise InputError(
            "bad-code",
            f"got {quote(body.strip())!r}, expected a code such as "
            f"{', '.join(repr(EXAMPLES[name]) for name in allowed)}.",
        )
    if len(fitting) > 1:
        raise InputError(
            "ambiguous-code",
            f"got {quote(body.strip())!r}, which can be read in several ways; write before it the "
            f"name of the notation: {', '.join(f'{name}:' for name in fitting)}.",
        )
    notation = fitting[0]
    if notation in CUBE_NOTATIONS:
        sequence = _read_sequence(body, notation)
        if len(sequence) > max_modules:
            raise too_many(len(sequence), max_modules, "modules")
        return sequence
    reader = _read_wolter if notation == "wolter" else _read_characters
    code = reader(body, notation, prisms)
    if code.prisms > max_modules:
        raise too_many(code.prisms, max_modules, "modules")
    check_overlap(code)
    return code


def is_twist_code(text: str) -> bool:
    """Return True if a text names a notation, or if it fits one and nothing else is written so."""
    if (match := _NAMED.match(text[:200])) and (
        (match[2] or "").lower() in (*EXAMPLES, *FAMILY_NAMES)
    ):
        return True
    if len(text) > MAX_CODE_CHARACTERS or _may_be_cells(text):
        return False
    return bool(notations_of(text, (*SNAKE_NOTATIONS, *CUBE_NOTATIONS)))


def notations_of(text: str, allowed: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of some notations in which a text can be written.

    A list of digits or numbers counts as a sequence if it has as many pieces as a cube, and
    otherwise only if nothing else fits and no notation of snakes is allowed. Whether a list of
    numbers is one of runs or of legs, only the sum tells.
    """
    fitting = tuple(name for name in allowed if _fits(text, name))
    likely = tuple(
        name for name in fitting if name in SNAKE_NOTATIONS or _is_likely_sequence(text, name)
    )
    only_cubes = not set(allowed) & set(SNAKE_NOTATIONS)
    return likely or (fitting if only_cubes else ())


def _may_be_cells(text: str) -> bool:
    """Return True for a short text, and for one with several lines or few columns of words.

    A code is one long word, a line of more words than a list of cells has columns, or a column.
    """
    lines = [line.split() for line in _SPACED.sub(" ", text).split("\n") if line.strip(" ")]
    if sum(len(word) for words in lines for word in words) < MIN_CODE_LETTERS:
        return True
    if len(lines) == 1:
        return 1 < len(lines[0]) <= MAX_COLUMNS and lines[0][0].isdecimal()
    return any(len(words) > 1 for words in lines)


def _split(text: str) -> tuple[int | None, str | None, str]:
    """Return the stated number of prisms, the name of the notation and the code."""
    match = _NAMED.fullmatch(text)
    if match is None:
        return None, None, text
    return (
        None if match[1] is None else int(match[1]),
        None if match[2] is None else match[2].lower(),
        match[3],
    )


def _fits(text: str, notation: str) -> bool:
    """Return True if a text has the form of a notation."""
    match notation:
        case "digits":
            return bool(re.fullmatch(r"[0-3]+", _without_closing(text)[0]))
        case "fiore":
            return bool(re.fullmatch(r"[DLUR]+", _without_closing(text)[0], re.I))
        case "glsnake":
            return bool(re.fullmatch(r"[ZRPL]+", _without_closing(_short_words(text))[0], re.I))
        case "wolter":
            return bool(_WOLTER.fullmatch(text.strip()))
        case "cube":
            return bool(re.fullmatch(r"[01]+", _compact(text)))
        case "letters":
            return bool(re.fullmatch(r"[ESC]+", _compact(text), re.I))
        case _:
            numbers = _numbers(text)
            return len(numbers) > 1 and min(_legs(numbers, notation)) > 0


def _pieces(text: str, notation: str) -> int:
    """Return the number of cubes that a text in a notation of snake cubes describes."""
    if notation in ("cube", "letters"):
        return len(_compact(text))
    return sum(_legs(_numbers(text), notation)) + 1


def _legs(numbers: tuple[int, ...], notation: str) -> tuple[int, ...]:
    """Return the steps of each straight run."""
    match notation:
        case "runs":
            return tuple(number - 1 for number in numbers)
        case "legs":
            return numbers
        case _:
            return (numbers[0] - 1, *numbers[1:])


def _is_likely_sequence(text: str, notation: str) -> bool:
    """Return True if a text is likely to be a sequence of pieces in a notation.

    It has as many pieces as a cube, and no corners at its ends. Letters for pieces are used for
    nothing else.
    """
    if notation in ("cube", "letters") and {_compact(text)[0], _compact(text)[-1]} & set("1Cc"):
        return False
    if notation == "letters":
        return True
    pieces = _pieces(text, notation)
    return any(side**3 == pieces for side in range(2, MAX_CUBE_SIDE + 1))


def _compact(text: str) -> str:
    return _SEPARATORS.sub("", text)


def _numbers(text: str) -> tuple[int, ...]:
    """Return the whole numbers of a list, with or without brackets; none if it is no list."""
    inner = text.strip()
    if inner[:1] + inner[-1:] in ("[]", "()", "{}"):
        inner = inner[1:-1].strip()
    if not _NUMBERS.fullmatch(inner):
        return ()
    return tuple(map(int, _NUMBER.findall(inner)))


def _short_words(text: str) -> str:
    """Return a text with the words of glsnake as letters."""
    return _GLSNAKE_WORD.sub(lambda match: _GLSNAKE_WORDS[match[0].upper()], text)


def _without_closing(text: str) -> tuple[str, str | None]:
    """Return a code without separators, and its closing digit or letter, or None."""
    match = _CLOSING.fullmatch(text)
    return (_compact(text), None) if match is None else (_compact(match[1]), match[2])


def _read_characters(text: str, notation: str, prisms: int | None) -> SnakeCode:
    """Return the code of digits or letters; the one that closes it is checked, and left out.

    Raises:
        InputError: ``bad-code``, ``wrong-count`` or ``closing-digit``.
    """
    body, closing = _without_closing(_short_words(text) if notation == "glsnake" else text)
    letters = LETTERS.get(notation, "0123")
    for place, character in enumerate(body.upper()):
        if character not in letters:
            raise InputError(
                "bad-code",
                f"got {quote(character)!r} after {place} joints, expected only {letters[0]}, "
                f"{letters[1]}, {letters[2]} and {letters[3]} in the notation {notation!r}.",
            )
    digits = tuple(letters.index(character) for character in body.upper())
    if closing is None and (prisms == len(digits) or prisms is None and _is_snake(len(digits))):
        digits = digits[:-1]
    code = SnakeCode(digits)
    if prisms not in (None, code.prisms):
        raise InputError(
            "wrong-count",
            f"got {len(body)} digits, expected {prisms - 1} joints of {prisms} prisms.",
        )
    if closing is not None:
        _check_closing(code, letters.find(closing.upper()))
    return code


def _check_closing(code: SnakeCode, digit: int) -> None:
    """Refuse a digit in brackets that does not close the figure.

    Raises:
        InputError: ``closing-digit``.
    """
    expected = closing_digit(code)
    if expected is None:
        raise InputError(
            "closing-digit",
            "got a closing digit in brackets, but the ends of this figure do not meet; check the "
            "code, or leave out the brackets with their digit.",
        )
    if digit != expected:
        raise InputError(
            "closing-digit",
            f"the digit in brackets does not fit the figure, whose ends meet with a {expected}; "
            "check the code.",
        )


def _is_snake(prisms: int) -> bool:
    return prisms >= MIN_SNAKE_PRISMS and prisms % SNAKE_STEP == 0


def _read_wolter(text: str, notation: str, prisms: int | None) -> SnakeCode:
    """Return the code of a list of turned joints, such as ``2L1-2R3``; all others are straight.

    Raises:
        InputError: ``bad-code``, or ``too-many-cells``.
    """
    if not _WOLTER.fullmatch(text.strip()):
        raise InputError(
            "bad-code",
            f"got {quote(text.strip())!r}, expected joints as {EXAMPLES[notation]!r}: the number "
            "of the prism, the side L or R, and 0 to 3 quarter turns.",
        )
    steps = [(int(n), side.upper(), int(turn)) for n, side, turn in _WOLTER_STEP.findall(text)]
    longest = 2 * max(number for number, _, _ in steps)
    if prisms is None:
        prisms = max(MIN_SNAKE_PRISMS, -(-longest // SNAKE_STEP) * SNAKE_STEP)
    if prisms > MAX_CELLS:
        raise too_many(prisms, MAX_CELLS, "modules")
    digits: list[int | None] = [None] * (prisms - 1)
    for number, side, turn in steps:
        joint = 2 * number - (2 if side == "R" else 3)
        step = f"{number}{side}{turn}"
        if not 0 <= joint < len(digits):
            raise InputError(
                "bad-code",
                f"got the step {step}, but a snake of {prisms} prisms has no such joint; expected "
                f"1R, 2L, 2R … to {_last_joint(prisms)}.",
            )
        if digits[joint] is not None:
            raise InputError(
                "bad-code",
                f"the step {step} turns a joint that an earlier step has turned; write one step "
                "with the sum of the turns.",
            )
        digits[joint] = turn if side == "R" else -turn % 4
    return SnakeCode(tuple(digit or 0 for digit in digits))


def _last_joint(prisms: int) -> str:
    joint = prisms - 2
    return f"{(joint + 1) // 2 + 1}{'LR'[joint % 2 == 0]}"


def _read_sequence(text: str, notation: str) -> CubeSequence:
    """Return the sequence that a text in a notation of snake cubes describes.

    Raises:
        InputError: ``bad-code``, ``corner-at-end`` or ``wrong-count``.
    """
    if notation in ("cube", "letters"):
        body = _compact(text).upper()
        straight, corner = ("0", "1") if notation == "cube" else ("SE", "C")
        if not body or set(body) - set(straight + corner):
            raise _bad_sequence(text, notation)
        return CubeSequence(tuple(character in corner for character in body))
    if not (numbers := _numbers(text)) or min(_legs(numbers, notation)) < 1:
        raise _bad_sequence(text, notation)
    if (pieces := _pieces(text, notation)) > MAX_CELLS:
        raise too_many(pieces, MAX_CELLS, "modules")
    return sequence_of_legs(_legs(numbers, notation))


def _bad_sequence(text: str, notation: str) -> InputError:
    return InputError(
        "bad-code",
        f"got {quote(text.strip())!r}, expected a sequence as {EXAMPLES[notation]!r}.",
    )
