"""``foldback-module/1``: the pieces of a module, their joints, and how they follow each other."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.display_names import clean_name
from foldback.planner.chain.module import Filling, JointKind, Module, ModuleWords, Piece
from foldback.planner.chain.polyhedron import Polyhedron, VolumeMoments, frozen, volume_moments
from foldback.planner.errors import InputError

MODULE_FORMAT: Final = "foldback-module/1"
MAX_MODULE_NAME: Final = 32
"""Maximum length of a module's name for programs, in characters."""
MAX_PIECES: Final = 16
"""Maximum number of pieces of a module, and of parts of a piece."""
MAX_CORNERS: Final = 32
"""Maximum number of corners of a part."""
MAX_MODULE_CORNERS: Final = 512
"""Maximum number of corners of all parts of a module."""
MAX_LENGTH: Final = 100.0
"""Maximum magnitude of a coordinate, in pitches."""
MAX_PATTERN: Final = 1_000_000
"""Maximum number of modules after which a pattern repeats."""
CENTRED: Final = 1e-12
"""Distance of the centre of mass from a frame's origin, in pitches, and product of inertia with
mass 1, in square pitches, up to which the frame of a file is kept as it is."""

END: Final = r"$(?!\n)"
"""End of a pattern: a dollar sign alone also matches before a final line break."""

Coordinate = Annotated[float, msgspec.Meta(ge=-MAX_LENGTH, le=MAX_LENGTH)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Text = Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
Degrees = Annotated[float, msgspec.Meta(ge=-36_000.0, le=36_000.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]


class Values(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """An object of the file; it has no other keys."""


class WordValues(Values, frozen=True):
    """What people call the module: one of them, and several."""

    singular: Text
    plural: Text


class PartValues(Values, frozen=True):
    """A convex body: the hull of its corners."""

    corners: Annotated[list[Vector], msgspec.Meta(min_length=4, max_length=MAX_CORNERS)]


class EndValues(Values, frozen=True):
    """Frame of a joint in a piece: its centre, and the directions of its x and y axes.

    The x axis points along the chain. At angle zero, the entry of a piece lies on the exit of the
    piece before it.
    """

    at: Vector
    x: Vector = (1.0, 0.0, 0.0)
    y: Vector = (0.0, 1.0, 0.0)


class HingeValues(Values, frozen=True):
    """A hinge: its axis in the frame of the exit, and its range; without one it turns freely."""

    axis: Vector
    range_deg: tuple[Degrees, Degrees] | None = None
    stop_deg: tuple[Degrees, Degrees] | None = None
    name: Annotated[str, msgspec.Meta(max_length=8, pattern=f"^[a-z0-9]*{END}")] = ""


class JointValues(Values, frozen=True):
    """The joint at the exit of a piece: a hinge, a twist about the link, or two hinges."""

    kind: JointKind
    hinges: Annotated[list[HingeValues], msgspec.Meta(min_length=1, max_length=2)]
    step_deg: Annotated[float, msgspec.Meta(gt=0.0, le=180.0)] | None = None


class PieceValues(Values, frozen=True):
    """A rigid body of the chain. Lengths are in pitches, in a frame of the author's choice."""

    name: Text
    parts: Annotated[list[PartValues], msgspec.Meta(min_length=1, max_length=MAX_PIECES)]
    entry: EndValues
    exit: EndValues
    joint: JointValues


class DrawingValues(Values, frozen=True):
    """Colours of successive modules, in turn, as in CSS."""

    colours: list[Annotated[str, msgspec.Meta(pattern=f"^#[0-9a-f]{{6}}{END}")]]


class ModuleValues(Values, frozen=True):
    """A module, as JSON values."""

    format: Literal["foldback-module/1"]
    name: Annotated[str, msgspec.Meta(pattern=f"^[a-z][a-z0-9-]*{END}", max_length=MAX_MODULE_NAME)]
    words: WordValues
    pieces: Annotated[list[PieceValues], msgspec.Meta(min_length=1, max_length=MAX_PIECES)]
    pattern: Annotated[list[Text], msgspec.Meta(min_length=1, max_length=MAX_PATTERN)]
    filling: Filling | None = None
    rest_deg: Annotated[list[Degrees], msgspec.Meta(max_length=MAX_PATTERN)] | None = None
    rigid_links: Annotated[int, msgspec.Meta(ge=0, le=1)] = 0
    linked_overlap: bool = False
    pitch_m: Positive | None = None
    mass_kg: Positive | None = None
    torque_nm: Positive | None = None
    speed_rad_s: Positive | None = None
    drawing: DrawingValues | None = None
    source: Annotated[str, msgspec.Meta(max_length=500)] = ""


def module_schema() -> dict[str, Any]:
    """Return the JSON schema of a module file."""
    return msgspec.json.schema(ModuleValues)


def read_module(document: Any) -> Module:
    """Return the module that a ``foldback-module/1`` object describes.

    Raises:
        InputError: The object is no valid module; names the place in it.
    """
    try:
        values = msgspec.convert(document, ModuleValues)
    except msgspec.ValidationError as error:
        text, _, place = str(error).partition(" - at ")
        raise InputError(
            "bad-module",
            f"{text[:1].lower()}{text[1:]}; correct the module file.",
            where=place.strip("`").removeprefix("$.") or None,
        ) from error
    return _module(values, document)


def with_pattern(module: Module, pattern: list[str], rest_deg: list[float] | None = None) -> Module:
    """Return a module whose pieces follow each other in another order.

    Args:
        module: The module.
        pattern: Name of the piece of each module of a period.
        rest_deg: Angle of the joint behind each in the rest shape, degrees; zero if None.

    Raises:
        InputError: A name is no piece of the module.
    """
    document = {key: v for key, v in module.document.items() if key != "rest_deg"}
    rest = {} if rest_deg is None else {"rest_deg": rest_deg}
    return read_module({**document, "pattern": pattern, **rest})


def _module(values: ModuleValues, document: dict[str, Any]) -> Module:
    corners = sum(len(part.corners) for piece in values.pieces for part in piece.parts)
    if corners > MAX_MODULE_CORNERS:
        raise _bad(
            "pieces",
            f"got {corners} corners in all parts, expected at most {MAX_MODULE_CORNERS}",
        )
    pieces = tuple(_piece(piece, k) for k, piece in enumerate(values.pieces))
    names = [piece.name for piece in pieces]
    hinge_names = tuple(hinge.name for hinge in values.pieces[0].joint.hinges)
    for k, piece in enumerate(values.pieces):
        if tuple(hinge.name for hinge in piece.joint.hinges) != hinge_names:
            raise _bad(
                f"pieces[{k}].joint",
                "the hinges of all joints must be equal in number and have the same names",
            )
    if len(set(hinge_names)) != len(hinge_names):
        raise _bad("pieces[0].joint", "the two hinges of a joint need different names")
    if unknown := [name for name in values.pattern if name not in names]:
        raise _bad("pattern", f"got {unknown[0]!r}, expected names of pieces: {', '.join(names)}")
    return Module(
        name=values.name,
        words=ModuleWords(
            _word(values.words.singular, "words.singular"),
            _word(values.words.plural, "words.plural"),
        ),
        filling=values.filling,
        pieces=pieces,
        pattern=tuple(names.index(name) for name in values.pattern),
        rest_rad=_rest(values, len(hinge_names)),
        hinge_names=hinge_names,
        rigid_links=values.rigid_links,
        apart=2 if values.linked_overlap else 1,
        mass_kg=values.mass_kg,
        torque_nm=values.torque_nm,
        speed_rad_s=values.speed_rad_s,
        pitch_m=values.pitch_m,
        colours=() if values.drawing is None else tuple(values.drawing.colours),
        document=document,
    )


def _word(text: str, place: str) -> str:
    if clean_name(text) != text:
        raise _bad(
            place,
            f"got {text!r} with characters that show nothing or move others, expected a word such "
            "as 'cube'",
        )
    return text


def _rest(values: ModuleValues, hinges: int) -> Array | None:
    if values.rest_deg is None:
        return None
    if len(values.rest_deg) != len(values.pattern):
        raise _bad(
            "rest_deg",
            f"got {len(values.rest_deg)} angles, expected one for each of the pattern's "
            f"{len(values.pattern)} modules",
        )
    if hinges != 1:
        raise _bad("rest_deg", "a rest shape is for joints of one hinge each")
    return frozen(np.deg2rad(values.rest_deg))


def _piece(values: PieceValues, number: int) -> Piece:
    place = f"pieces[{number}]"
    parts = tuple(_part(part.corners, f"{place}.parts[{k}]") for k, part in enumerate(values.parts))
    moments = volume_moments(parts)
    origin, axes = _frame(moments)
    entry, entry_axes = _end(values.entry, f"{place}.entry")
    exit_, exit_axes = _end(values.exit, f"{place}.exit")
    hinges, step = values.joint.hinges, values.joint.step_deg
    is_centred = np.array_equal(axes, np.eye(3)) and not origin.any()
    return Piece(
        name=values.name,
        parts=parts if is_centred else tuple(part.moved(origin, axes) for part in parts),
        volume=moments.volume,
        inertia=frozen(np.diag(axes.T @ moments.inertia @ axes)),
        entry=frozen((entry - origin) @ axes),
        entry_axes=frozen(axes.T @ entry_axes),
        exit=frozen((exit_ - origin) @ axes),
        exit_axes=frozen(axes.T @ exit_axes),
        joint_kind=values.joint.kind,
        axes=frozen(
            [
                axes.T @ exit_axes @ _unit(hinge.axis, f"{place}.joint.hinges[{k}].axis")
                for k, hinge in enumerate(hinges)
            ]
        ),
        ranges_rad=frozen([_range(hinge.range_deg, place) for hinge in hinges]),
        stops_rad=frozen([_range(hinge.stop_deg or hinge.range_deg, place) for hinge in hinges]),
        step_rad=None if step is None else float(np.deg2rad(step)),
    )


def _part(corners: list[Vector], place: str) -> Polyhedron:
    try:
        return Polyhedron.of_corners(np.array(corners, dtype=np.float64))
    except ValueError as error:
        text, corner = error.args
        if corner < 0:
            raise _bad(place, f"{text}; give the corners of a body with a volume") from error
        raise _bad(
            f"{place}.corners[{corner}]",
            f"{text}; a part must be convex, so split it into several parts",
        ) from error


def _frame(moments: VolumeMoments) -> tuple[Array, Array]:
    """Return the origin and the axes, as columns, of the frame that a piece gets."""
    products = moments.inertia - np.diag(np.diag(moments.inertia))
    if max(np.abs(moments.centre).max(), np.abs(products).max()) <= CENTRED:
        return np.zeros(3), np.eye(3)
    if np.abs(products).max() <= CENTRED:
        return moments.centre, np.eye(3)
    axes = np.linalg.eigh(moments.inertia)[1]
    # The signs that turn the frame least.
    order = [int(np.abs(axes[k]).argmax()) for k in range(3)]
    axes = axes[:, order] if len(set(order)) == 3 else axes
    axes = axes * np.where(np.diag(axes) < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return moments.centre, axes


def _end(values: EndValues, place: str) -> tuple[Array, Array]:
    x, y = _unit(values.x, f"{place}.x"), _unit(values.y, f"{place}.y")
    if abs(x @ y) > 1e-6:
        raise _bad(f"{place}.y", "expected a direction at a right angle to x")
    return np.array(values.at), np.stack([x, y, np.cross(x, y)], axis=1)


def _unit(vector: Vector, place: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-6:
        raise _bad(place, "got a direction of length 0, expected a vector such as [0, 0, 1]")
    return np.array(vector) / length


def _range(range_deg: tuple[float, float] | None, place: str) -> tuple[float, float]:
    if range_deg is None:
        return -np.inf, np.inf
    low, high = range_deg
    if not low < high:
        raise _bad(
            f"{place}.joint", f"got the range {low:g}° to {high:g}°, expected the smaller one first"
        )
    return float(np.deg2rad(low)), float(np.deg2rad(high))


def _bad(place: str, text: str) -> InputError:
    return InputError("bad-module", f"{text}; correct the module file.", where=place)


__all__ = ["MODULE_FORMAT", "module_schema", "read_module", "with_pattern"]
