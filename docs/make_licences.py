"""Write docs/licences.md: the licence of every package that an installation contains.

The packages are those that foldback needs at run time, with all that they need in turn, in the
versions of ``constraints.txt``. Run it where these are installed: ``python -m docs.make_licences``.
"""

from __future__ import annotations

import re
from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "licences.md"
BLAS: Final = "OpenBLAS, BSD-3-Clause; libgfortran and libgcc, GPL-3.0 WITH GCC-exception-3.1"
BUNDLED: Final = {
    "numpy": BLAS,
    "scipy": BLAS,
    "psycopg-binary": "libpq, PostgreSQL; OpenSSL, Apache-2.0; MIT Kerberos, MIT; OpenLDAP, "
    "OLDAP-2.8; Cyrus SASL, BSD",
    "python-sat": "CaDiCaL, MIT; other SAT solvers, which foldback does not use",
    "pillow": "libavif, libjpeg-turbo, libpng, libtiff, libwebp, FreeType and others, "
    "listed in its LICENSE",
    "mujoco": "small libraries, listed in its LICENSES_THIRD_PARTY.md",
    "zstandard": "Zstandard, BSD-3-Clause",
    "resvg-py": "resvg and other Rust libraries, listed in its sboms: MIT, Apache-2.0, BSD, Zlib",
}
"""Native libraries and programs inside of wheels, by package, as their licence files list them."""
MIT_GRANT: Final = "Permission is hereby granted, free of charge, to any person obtaining a\ncopy"
"""Beginning of the MIT licence, of packages that state no licence beside its text."""
TEXT: Final = """\
# Licences

foldback itself is under the [MIT licence](../LICENSE). `make run` and the container image also
install the packages in the table below. The text of each licence is in
`site-packages/NAME.dist-info`. `python -m docs.make_licences` writes this page.

The image also contains Debian packages; their licences are in `/usr/share/doc`. One of these
packages is FFmpeg with x264, which foldback runs as a separate program to encode MP4 movies.
Debian's build of FFmpeg is under the GNU General Public License, version 2 or later: if you
distribute the image, you also distribute FFmpeg under that licence. The source code of Debian's
build is in the Debian source package `ffmpeg`. `make run` installs no FFmpeg. The extra
`foldback[movies]` installs a build of FFmpeg under the GNU General Public License, version 3 or
later. The extra `foldback[ipctk]` installs the IPC Toolkit, under the MIT licence.

The compiled core contains parts of nanobind, under the BSD-3-Clause licence, and of robin-map,
under the MIT licence; both texts are in `planner/core/licences.txt`.

The page of a fold loads a part of mediabunny (`web/static/js/film/mediabunny.js`), under the
Mozilla Public License, version 2.0, when a visitor makes a film. Its source code is at
<https://github.com/Vanilagy/mediabunny>; `make muxer` builds the file from the package.

Text in pictures and leaflets uses a subset of the font DejaVu Sans
(`planner/exports/dejavu-sans.ttf`). The font's permissive licence, by Bitstream and Tavmjong Bah,
is in the font file.

| package | version | licence | contains other libraries |
|---|---|---|---|
"""


def page() -> str:
    """Return the text of the page."""
    return TEXT + "".join(f"{row}\n" for row in rows())


def rows() -> list[str]:
    """Return a row of the table for each package, by name."""
    return [
        f"| {name} | {distribution.version} | {licence_of(distribution)} | "
        f"{BUNDLED.get(name, '')} |"
        for name, distribution in sorted(installed("foldback").items())
        if name != "foldback"
    ]


def installed(root: str) -> dict[str, Distribution]:
    """Return a package and all that it needs at run time, by canonical name."""
    distributions: dict[str, Distribution] = {}
    waiting = [(root, frozenset({"service", "storage"}))]  # the extras of the image
    visited: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        name, extras = waiting.pop()
        if (name, extras) in visited:
            continue
        visited.add((name, extras))
        distributions[name] = distribution(name)
        for text in distributions[name].requires or ():
            needed = Requirement(text)
            if needed.marker is None or any(
                needed.marker.evaluate({"extra": extra}) for extra in ("", *extras)
            ):
                waiting.append((canonicalize_name(needed.name), frozenset(needed.extras)))
    return distributions


def licence_of(package: Distribution) -> str:
    """Return the licence that a package states: its expression, its classifiers or its first line.

    Raises:
        ValueError: If it states none.
    """
    about = package.metadata
    if stated := about.get("License-Expression"):
        return stated
    classifiers = [
        line.rsplit(" :: ", 1)[1]
        for line in about.get_all("Classifier") or ()
        if line.startswith("License :: ") and line.count(" :: ") > 1
    ]
    if classifiers:
        return ", ".join(sorted(set(classifiers)))
    if stated := re.sub(r"\s+", " ", (about.get("License") or "").strip())[:60]:
        return stated
    if (text := package.read_text("licenses/LICENSE")) and MIT_GRANT in text:
        return "MIT"
    if package.read_text("licenses/LICENSE.txt") or package.read_text("LICENSE"):
        return "see its licence file"
    raise ValueError(f"{about['Name']} states no licence; look it up and add it here.")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
