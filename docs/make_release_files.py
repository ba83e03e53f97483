"""Make again all files that a new version of foldback changes, in the order of docs/releases.md.

python -m docs.make_release_files [--dry-run]
"""

from __future__ import annotations

import subprocess
import sys
from typing import Final

STEPS: Final = (
    ("golden digests", "tests.golden", "--store"),
    ("shipped folds", "examples.make_shipped_folds"),
    ("sweeps", "bench.stored_sweeps", "gallery", "table", "success-map"),
    ("page of the paper", "bench.reproduction", "--stale"),
    ("pictures", "examples.make_pictures"),
    ("texts of the service", "tests.server.contract", "--store"),
)
"""Name of the files of each step, then the module that makes them and its arguments. A step may
need the files of those before it."""


def main() -> None:
    """Run all steps, or list them; stop at the first that fails."""
    for name, module, *arguments in STEPS:
        print(f"{name}: python -m {module} {' '.join(arguments)}".rstrip(), flush=True)
        if "--dry-run" not in sys.argv[1:]:
            subprocess.run([sys.executable, "-m", module, *arguments], check=True)


if __name__ == "__main__":
    main()
