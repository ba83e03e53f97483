"""Read cells in several formats, and show the error of a file that cannot be used."""

from __future__ import annotations

from foldback.planner.errors import InputError
from foldback.planner.readers import read

FILES = {
    "corner.csv": b"x,y,z\n0,0,0\n1,0,0\n1,1,0\n",
    "corner.xyz": b"0 0 0\n1 0 0\n1 1 0\n",
    "corner.json": b"[[0, 0, 0], [1, 0, 0], [1, 1, 0]]",
    "gap.csv": b"0,0,0\n1,0,0\n3,0,0\n",
    "half.xyz": b"0 0 0\n1 0 0\n1 0.5 0\n",
    "picture.json": b"\x89PNG\r\n\x1a\n",
}


def main() -> None:
    for filename, data in FILES.items():
        try:
            shape = read(data, filename=filename)
        except InputError as error:
            print(f"{filename}: {error.code}: {error}")
        else:
            print(f"{filename}: {len(shape)} modules, named {shape.name!r}")


if __name__ == "__main__":
    main()
