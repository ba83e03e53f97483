"""Options of the conversion of a shape into a chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Final, Self

from foldback.planner.chain.built_in_modules import (
    DEFAULT_MODULE,
    MODULE_NAMES,
    filling_named,
    module_named,
    words_named,
)
from foldback.planner.chain.module import Module
from foldback.planner.parameters.option import Choice, Choices, option, options_of
from foldback.planner.parameters.parameters import FLOATING, WORLD_CHOICES, World
from foldback.planner.parameters.settings_text import TABLE_SETTINGS, names_with_units
from foldback.planner.pathfinding import FILLINGS, PATH_ENDS, PATH_METHODS, Cell
from foldback.planner.pathfinding.start_cell import CELL_TEXT, parse_cell
from foldback.planner.storage.plain_values import from_plain

DEFAULT_MODULES: Final = 160
"""Number of modules into which a mesh is divided if the request states none."""
DEFAULT_DRAWN_MODULES: Final = 800
"""Number of modules of a picture's silhouette if the request states none: a hundred cells of 2×2×2
modules."""
MAX_THICKNESS_CELLS: Final = 16
"""Maximum thickness, in cells, of a word or picture; a request for more is refused."""
MODULE_COUNTS: Final = (8, 20_000)
"""Minimum and maximum number of modules that a request may ask for; other numbers are refused."""
MAX_TABLE_MODULES: Final = 96
"""Maximum number of modules of the variants of a shape that are offered for folding on a table;
larger ones mostly get stuck. Measured: tori of 88 and 96 fold in six to eight minutes of processor
time, one of 160 gets stuck (decision 0026)."""
MODULE_CHOICES: Final[Choices] = {
    name: Choice(label=words_named(name, None).plural.capitalize())
    for name in MODULE_NAMES
    if filling_named(name) in FILLINGS
}
"""Kinds of modules that a shape can be made of."""


def table_warning(modules: int, world: World) -> str:
    """Return what to know before a long chain folds on a table; empty if there is nothing."""
    if world != "table" or modules <= MAX_TABLE_MODULES:
        return ""
    return f"Chains of more than {MAX_TABLE_MODULES} modules usually get stuck on a table."


@dataclass(frozen=True, slots=True, kw_only=True)
class PathOptions:
    """Options of the conversion of a shape into a chain: what a preview and a fold have in common.

    Values are checked by ``check`` alone, with the same message for every interface.
    """

    module: str = option(
        DEFAULT_MODULE,
        title="Module type",
        help="Module type for meshes, voxels and cells. A chain file states its own type.",
        label="Modules are",
        choices=MODULE_CHOICES,
    )
    modules: int | None = option(
        None,
        title="Approximate number of modules, for a mesh or a picture",
        noun="number of modules",
        help=f"Approximate number of modules. Default for meshes: {DEFAULT_MODULES}, for pictures: "
        f"{DEFAULT_DRAWN_MODULES}.",
        label="Modules",
        range=MODULE_COUNTS,
    )
    method: str = option(
        "auto",
        title="Path method",
        help="Method that finds the path. `blocks` splits each cell into 2×2×2 modules, "
        "`fitted` chooses the cells of a mesh together with the path, `exact` uses one module for "
        "each cell and, in zero gravity, meets the number of modules of a mesh exactly, and "
        "`snake` works only for boxes.",
        label="Path",
        choices=PATH_METHODS,
    )
    repair: bool = option(False, title="Add or remove cells if the shape has no path")
    ends: str = option(
        "any",
        title="Ends of the chain",
        help="`surface` puts both ends of the chain on the outside.",
        label="Ends of the chain",
        choices=PATH_ENDS,
    )
    threshold: int | None = option(
        None,
        title="Brightness that divides a picture into figure and background, in percent",
        noun="threshold",
        help="For a picture: brightness, in percent, that divides it into figure and background. "
        "Default: transparent pixels are the background, or the brightness that divides the "
        "picture best.",
        label="Threshold, % bright",
        range=(1, 99),
        unit="percent",
    )
    inside_out: bool = option(
        False, title="Fold the background of a picture, not its figure", label="Inside out"
    )
    thickness: int = option(
        1,
        title="Thickness of a word or picture, in cells",
        noun="thickness",
        label="Thickness, cells",
        range=(1, MAX_THICKNESS_CELLS),
        unit="cells",
    )
    as_voxels: bool = option(False, title="Read a list of cells as a shape, not as a path")
    start: Cell | None = option(
        None,
        title="The cell where the chain starts",
        help="The cell where the chain starts, as `x,y,z`. The field `cells` of the preview lists "
        "all cells.",
        pattern=rf"^{CELL_TEXT}$",
        metavar="X,Y,Z",
        parse=parse_cell,
    )
    world: World = option(
        FLOATING,
        title="World",
        help="World: `floating` has no gravity; on a `table` the chain is always supported and "
        "its torques are limited. Settings for a table: "
        f"{names_with_units(TABLE_SETTINGS)}; w·p is module weight × pitch.",
        label="Fold",
        choices=WORLD_CHOICES,
    )

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return a request of typed values: numbers and the cell may still be texts.

        Raises:
            InputError: When one of them cannot be read.
        """
        options = options_of(cls)
        read = {name: options[name].read(values[name]) for name in values if name in options}
        return cls(**{**values, **read})

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Return the request that ``to_json`` wrote; what it lacks has its default.

        Raises:
            ValueError: A value has another type.
        """
        return from_plain(values, cls)

    def to_json(self) -> dict[str, Any]:
        """Return all values for a JSON file."""
        return asdict(self)

    def changed(self) -> dict[str, Any]:
        """Return the options that differ from their defaults."""
        return {
            name: getattr(self, name)
            for name, described in options_of(type(self)).items()
            if getattr(self, name) != described.default
        }

    @property
    def kind(self) -> Module:
        """The module that a shape is made of."""
        return module_named(self.module)

    def path_options(self) -> PathOptions:
        """Return only the options that turn a shape into a path."""
        return PathOptions(
            **{field.name: getattr(self, field.name) for field in fields(PathOptions)}
        )

    def check(self) -> None:
        """Refuse invalid options.

        Raises:
            InputError: An option is invalid; names it in ``where``.
        """
        for name, described in options_of(type(self)).items():
            described.check(getattr(self, name))
