"""Gallery: the example shapes, from `examples` in a checkout, else from the package."""

from __future__ import annotations

import json
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Final

from foldback.planner.chain.built_in_modules import DEFAULT_MODULE, document_of, words_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import ModuleWords
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.errors import InputError
from foldback.planner.readers.formats import read

MAX_LISTED_EXAMPLES: Final = 6
"""Maximum number of suitable gallery examples that the error about a wrong kind of module or number
of modules lists; further ones are only counted."""
TABLE_RESULTS: Final = "table_results.json"
"""Name of the file that lists the gallery examples which fold on a table, with the joint torque of
each; ``python -m bench.stored_sweeps table`` writes it."""
DEFAULT_TAGS: Final = ("paper",)
"""Tags of gallery shapes whose file names none; these are the shapes of the published paper."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GalleryShape:
    """One example shape.

    Attributes:
        name: Its stem, as ``POST /api/folds`` takes it.
        title: Title for people.
        modules: Modules of its chain.
        module: Name of its modules.
        words: What its modules are called.
        data: The bytes of its path or chain file.
        tags: Kinds of shapes: ``animal``, ``tool``, ``letter`` …
        rests_within: Torque in w·p within which it is known to rest on a table, without friction;
            None where nothing of the kind is known.
    """

    name: str
    title: str
    modules: int
    data: bytes
    tags: tuple[str, ...] = ()
    module: str = DEFAULT_MODULE
    words: ModuleWords = words_named(DEFAULT_MODULE, None)
    rests_within: float | None = None

    @property
    def counted(self) -> str:
        """Number of its modules with their kind, for example "160 cubes"."""
        return self.words.counted(self.modules)

    @property
    def chain(self) -> Chain:
        """Its chain, read from its file, which contains a path or a chain."""
        contents = read(self.data, filename=self.filename)
        if isinstance(contents, CellPath):
            return Chain.from_path(contents)
        assert isinstance(contents, Chain), f"{self.name} is a path or a chain"
        return contents

    @property
    def filename(self) -> str:
        """The name of its file."""
        return f"{self.name}.json"


@cache
def gallery() -> tuple[GalleryShape, ...]:
    """Return all example shapes, shortest chain first; read once."""
    resting = _resting()
    shapes = [
        _shape(entry, resting)
        for entry in shapes_directory().iterdir()
        if entry.is_file() and entry.name.endswith(".json")
    ]
    return tuple(sorted(shapes, key=lambda shape: (shape.modules, shape.name)))


class Gallery:
    """The example shapes, as a service has them."""

    def shapes(self) -> tuple[GalleryShape, ...]:
        """Return all examples, shortest chain first."""
        return gallery()

    def shape(self, name: str) -> GalleryShape | None:
        """Return the example of this name, or None."""
        return next((shape for shape in self.shapes() if shape.name == name), None)

    def nearest(self, name: str) -> str:
        """Return the number of examples and those with similar names, in words."""
        names = [shape.name for shape in self.shapes()]
        near = ", ".join(get_close_matches(name.lower(), names, n=4, cutoff=0.5))
        return f"{len(names)} examples" + (f", such as {near}" if near else "")

    def fitting(self, module: str, modules: int) -> tuple[GalleryShape, ...]:
        """Return the examples that a chain of a kind and length folds into."""
        return tuple(s for s in self.shapes() if (s.module, s.modules) == (module, modules))

    def advised(self, error: InputError, module: str, modules: int) -> InputError:
        """Return the refusal to refold a chain into an unsuitable shape, with suitable ones."""
        if error.code != "refold-differs":
            return error
        names = [shape.name for shape in self.fitting(module, modules)]
        suffix = (
            f" and {len(names) - MAX_LISTED_EXAMPLES} more"
            if len(names) > MAX_LISTED_EXAMPLES
            else ""
        )
        fit = f"these examples fit: {', '.join(names[:MAX_LISTED_EXAMPLES])}{suffix}"
        return error.changed(
            f"{error.template.removesuffix('.')}; {fit if names else 'no example fits'}."
        )


def shapes_directory() -> Path:
    """Return the directory with the path files of the example shapes."""
    planner = Path(__file__).resolve().parents[1]
    checkout = planner.parent / "examples" / "shapes"
    return checkout if checkout.is_dir() else planner / "examples"


def _resting() -> dict[str, float]:
    """Shapes that were found to rest on a table, and the torque in w·p that each asks."""
    directory = shapes_directory()
    for file in (
        Path(__file__).resolve().parents[1] / TABLE_RESULTS,
        directory.parent / TABLE_RESULTS,
    ):
        if file.is_file():
            shapes = json.loads(file.read_bytes())["shapes"]
            return {
                name: float(result["torque_wp"])
                for name, result in shapes.items()
                if result["verified"]
            }
    return {}


def _shape(entry: Path, resting: dict[str, float]) -> GalleryShape:
    data = entry.read_bytes()
    content = json.loads(data)
    name = entry.name.removesuffix(".json")
    module = document_of(content.get("module", DEFAULT_MODULE))
    if "cells" in content:
        modules = len(content["cells"])
    else:
        modules = len(content["joint_angles_deg"]) + 1 + module.get("rigid_links", 0)
    title = str(content.get("title") or content.get("name") or name)
    return GalleryShape(
        name=name,
        title=title.removesuffix(f", {modules} modules"),
        modules=modules,
        module=module["name"],
        words=ModuleWords(**module["words"]),
        tags=tuple(map(str, content.get("tags", DEFAULT_TAGS))),
        data=data,
        rests_within=resting.get(name),
    )
