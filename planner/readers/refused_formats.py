"""Formats that are refused: their signatures, recognised only for the error message."""

from __future__ import annotations

from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.readers.limits import quote

HTML_PAGE: Final = "an HTML page"
SIGNATURES: Final = (
    (b"GIF8", "a GIF picture"),
    (b"RIFF", "a WebP picture, a sound or a video"),
    (b"%PDF", "a PDF document"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"PK\x05\x06", "an empty zip archive"),
    (b"7z\xbc\xaf", "a 7z archive"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive"),
    (b"\x7fELF", "a program"),
    (b"MZ", "a program"),
    (b"\x89HDF", "an HDF5 file"),
    (b"SQLite format 3", "an SQLite database"),
    (b"ISO-10303", "a STEP model"),
    (b"Kaydara FBX", "an FBX scene"),
    (b"; FBX", "an FBX scene"),
    (b"BLENDER", "a Blender project"),
    (b"#VRML", "a VRML scene"),
    (b"#usda", "a USD scene"),
    (b"PXR-USDC", "a USD scene"),
    (b"# .PCD", "a point cloud"),
    (b"# vtk DataFile", "a VTK data set"),
    (b"DBRep_DrawableShape", "a BREP model"),
    (b"3D Geometry File Format", "a Rhino model"),
    (b"AC10", "an AutoCAD drawing"),
    (b"\xd0\xcf\x11\xe0", "an office or CAD document"),
)
POINTERS: Final = (
    (b"version https://git-lfs.github.com/spec/", "Git LFS", "git lfs pull"),
    (b"version https://hawser.github.com/spec/", "Git LFS", "git lfs pull"),
    (b"/annex/objects/", "git-annex", "git annex get"),
    (b"../.git/annex/objects/", "git-annex", "git annex get"),
    (b".git/annex/objects/", "git-annex", "git annex get"),
)
"""Beginnings of files that stand for a large file in a Git repository, the program that writes
them, and the command that fetches the large file."""
XML_KINDS: Final = (
    (b"<!doctype html", HTML_PAGE),
    (b"<html", HTML_PAGE),
    (b"<amf", "an AMF model"),
    (b"<collada", "a COLLADA scene"),
    (b"<x3d", "an X3D scene"),
)


def refuse_other_kinds(data: bytes, expected: str) -> None:
    """Refuse a file with the signature of an unsupported format.

    Raises:
        InputError: ``wrong-kind``; says what the file looks like. ``pointer`` for a text that
            stands for a file in a repository; says how to get the file.
    """
    for signature, program, command in POINTERS:
        if data.startswith(signature):
            raise InputError(
                "pointer",
                f"this is a pointer of {program}, which stands for the real file in a repository; "
                f"fetch the real file with '{command}', or download it from the repository's page.",
            )
    kind = looks_like(data)
    if kind == HTML_PAGE:
        kind = f"{HTML_PAGE}, perhaps the page from which the file can be downloaded"
    if kind is not None:
        raise wrong_kind(f"this looks like {kind}", expected)


def wrong_kind(description: str, expected: str) -> InputError:
    """Return the error for a file of an unsupported format."""
    return InputError("wrong-kind", f"{description}, expected {expected}.")


def unknown_kind(text: str, expected: str) -> InputError:
    """Return the refusal of text that no reader recognises."""
    start = text.strip()[:200]
    return wrong_kind(
        f"this looks like text in an unknown format (it begins with {quote(start)!r})", expected
    )


def looks_like(data: bytes) -> str | None:
    """Return a description of an unsupported file, or None if it may be readable."""
    for signature, kind in SIGNATURES:
        if data.startswith(signature):
            return kind
    start = data[:2048].lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith(b"<"):
        lower = start.lower()
        for mark, kind in XML_KINDS:
            if mark in lower:
                return kind
        return "an XML or HTML file"
    if start.split(maxsplit=2)[:2] == [b"0", b"SECTION"]:
        return "a DXF drawing"
    if data[72:80] == b"S      1":
        return "an IGES model"
    return None
