"""Draw the packages of the code and the imports between them, and list them in architecture.md.

A component is a folder or a module of a package. Tests check that imports follow the layers below,
and that both files are current.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parent
PAGE: Final = HERE / "architecture.md"
PICTURE: Final = HERE / "pictures" / "architecture.svg"
BEGIN, END = "<!-- components -->\n", "<!-- end of components -->\n"
LAYERS: Final = (
    ("planner",),
    ("planner.storage",),
    ("planner.core", "planner.modules"),
    ("planner.chain",),
    ("planner.parameters", "planner.twist_chains"),
    ("planner.shapes", "planner.motion", "planner.simulation"),
    ("planner.silhouettes",),
    ("planner.clearance", "planner.readers"),
    ("planner.statics",),
    ("planner.pathfinding", "planner.playback", "planner.turns"),
    ("planner.table_paths", "planner.reachability"),
    ("planner.path_fit",),
    ("planner.explosion.loop", "planner.certificate"),
    ("planner.explosion.peeling",),
    ("planner.explosion.table",),
    ("planner.explosion",),
    ("planner.plan",),
    ("planner.smoothing", "planner.trajectories"),
    ("planner.servos",),
    ("planner.exports",),
    ("planner.pipeline",),
    ("planner.verification",),
    ("planner.sweeps",),
    ("web",),
    ("web.pictures",),
    ("web.timeline",),
    ("web.viser",),
    ("web.movies",),
    ("words",),
    ("cli",),
    ("server.errors", "server.settings"),
    ("server.limits",),
    ("server.store",),
    ("server.ops",),
    ("server.http",),
    ("server.processes",),
    ("server.files",),
    ("server.jobs",),
    ("server.schemas",),
    ("server.viewing", "server.target_streams"),
    ("server.live_class",),
    ("server.context",),
    ("server.dependencies",),
    ("server.submission",),
    ("server.api",),
    ("server.pages",),
    ("server.app",),
    ("server.doctor", "server.admin"),
    ("server.cli",),
)
"""Components by layer, from the lowest layer up. A component imports only from lower layers, or
from itself."""
LAYER_OF: Final = {name: layer for layer, names in enumerate(LAYERS) for name in names}
ELSEWHERE: Final = ("server.migrations",)
"""Folders whose layout alembic prescribes; they belong to no component."""
WIDTH, COLUMN, STEP, BOX = 1020, 340, 58, 38
"""Width of the picture, width of a column, distance between layers, and height of a box, px."""
COLOURS: Final = {
    "planner": "#2f6fb2",
    "web": "#3a8a5c",
    "words": "#8a5a9c",
    "cli": "#8a5a9c",
    "server": "#b06a2c",
}
COLUMNS: Final = {"planner": ("planner",), "web": ("web", "words"), "server": ("cli", "server")}
"""Columns of the picture, with the packages that each of them shows."""


@dataclass(frozen=True, slots=True)
class Import:
    """An import of one module by another.

    Attributes:
        module: Dotted name of the module that imports.
        imported: Dotted name of the module that is imported.
    """

    module: str
    imported: str


@cache
def modules() -> dict[str, Path]:
    """Return all modules of the packages by their dotted names."""
    paths = (path for package in COLOURS for path in (ROOT / package).rglob("*.py"))
    named = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}
    return {name.removesuffix(".__init__"): path for name, path in sorted(named.items())}


def component_of(module: str) -> str | None:
    """Return the component that a module is in; None for modules that belong to no component.

    Raises:
        KeyError: If its folder is not listed in ``LAYERS``.
    """
    if module.startswith(ELSEWHERE):
        return None
    path = modules()[module]
    component = module if path.name == "__init__.py" else module.rpartition(".")[0]
    if module in LAYER_OF:
        return module
    if component in LAYER_OF:
        return component
    if path.parent == ROOT / component:
        return None
    raise KeyError(
        f"{module} is in no component: add its folder to LAYERS in {Path(__file__).name}"
    )


def _place(module: str) -> str:
    """Return a module's name by the folders of the repository, of which ``foldback`` has links."""
    return module.removeprefix("foldback.")


@cache
def imports() -> tuple[Import, ...]:
    """Return all imports between modules of the packages, also those inside functions."""
    file_imports: list[Import] = []
    module_names = modules()
    for module, path in module_names.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                inner = [f"{node.module}.{alias.name}" for alias in node.names]
                names = [name if _place(name) in module_names else node.module for name in inner]
            names = [_place(name) for name in names]
            file_imports += [Import(module, name) for name in names if name in module_names]
    return tuple(file_imports)


def arrows() -> set[tuple[str, str]]:
    """Return the pairs of different components of which the first imports from the second."""
    pairs = (
        (component_of(found_import.module), component_of(found_import.imported))
        for found_import in imports()
    )
    return {(a, b) for a, b in pairs if a and b and a != b}


def files_of(component: str) -> list[Path]:
    """Return the files of a component without its ``__init__.py``."""
    return [
        path
        for module, path in modules().items()
        if path.name != "__init__.py" and component_of(module) == component
    ]


def summary_of(component: str) -> str:
    """Return the first line of a component's docstring."""
    path = modules()[component]
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def markdown_rows() -> str:
    """Return the components from the top down as rows in Markdown."""
    lines = ["| component | purpose | files |", "|---|---|---|"]
    for component in (component for layer in reversed(LAYERS) for component in layer):
        names = ", ".join(f"`{path.stem}`" for path in files_of(component))
        lines.append(f"| `{component.replace('.', '/')}` | {summary_of(component)} | {names} |")
    return "\n".join(lines) + "\n"


def with_rows(page: str) -> str:
    """Return the page with current rows."""
    before, _, page_end = page.partition(BEGIN)
    _, _, after = page_end.partition(END)
    return f"{before}{BEGIN}\n{markdown_rows()}\n{END}{after}"


def draw() -> str:
    """Return the picture as SVG: a column per package, a box per component, lines for imports."""
    columns = {
        column: [
            components
            for layer in LAYERS
            if (components := [name for name in layer if name.split(".")[0] in packages])
        ]
        for column, packages in COLUMNS.items()
    }
    height = STEP * max(map(len, columns.values())) + 60
    at: dict[str, tuple[float, float, float]] = {}
    for column, layers in enumerate(columns.values()):
        for k, components in enumerate(layers):
            wide = (COLUMN - 50) / len(components)
            for j, component in enumerate(components):
                middle = column * COLUMN + 25 + wide * (j + 0.5)
                at[component] = (middle, height - 30 - STEP * (k + 0.5), wide - 8)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        'font-family="system-ui, sans-serif" font-size="13">',
        "<title>Components of the code; every line leads down or to a column on the left, "
        "from a component to one that it imports</title>",
        f'<rect width="{WIDTH}" height="{height}" fill="#fbfaf7"/>',
    ]
    for component, imported in sorted(arrows()):
        (x, y, _), (u, v, _) = at[component], at[imported]
        bend = 60 if abs(x - u) < 1 else 0
        parts.append(
            f'<path d="M{x:.0f} {y:.0f} C{x - bend:.0f} {y + 25:.0f} {u - bend:.0f} {v - 25:.0f} '
            f'{u:.0f} {v:.0f}" fill="none" stroke="{COLOURS[component.split(".")[0]]}" '
            f'stroke-width="1.2" stroke-opacity=".28"/>'
        )
    for component, (x, y, wide) in at.items():
        package, _, name = component.partition(".")
        count = len(files_of(component))
        words = f"{name or package} · {count}" if count > 1 else name or package
        parts.append(
            f'<rect x="{x - wide / 2:.0f}" y="{y - BOX / 2:.0f}" width="{wide:.0f}" '
            f'height="{BOX}" rx="6" fill="#fff" stroke="{COLOURS[package]}"/>'
            f'<text x="{x:.0f}" y="{y + 4:.0f}" text-anchor="middle" fill="#222">{words}</text>'
        )
    for column, package in enumerate(COLUMNS):
        parts.append(
            f'<text x="{(column + 0.5) * COLUMN:.0f}" y="{height - 10}" text-anchor="middle" '
            f'font-weight="600" fill="{COLOURS[package]}">{package}</text>'
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    PAGE.write_text(with_rows(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
