"""``python -m tests.server.contract [--store]``: differences of texts from the stored ones.

With ``--store`` the current texts become the expected ones. Store them only at a commit whose
change is intended.
"""

import argparse
import difflib
import tempfile
from pathlib import Path

from tests.server.contract.texts import store, stored, texts


def main() -> int:
    """Show the differences, or store the texts; return 1 if some differ."""
    parser = argparse.ArgumentParser(prog="python -m tests.server.contract", description=__doc__)
    parser.add_argument("--store", action="store_true", help="store the current texts")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        current = texts(Path(directory) / "data")
    known_stored = stored()
    changed = False
    for name in sorted(known_stored.keys() | current.keys()):
        before, after = known_stored.get(name, ""), current.get(name, "")
        if before != after:
            changed = True
            old, new = before.splitlines(), after.splitlines()
            print("\n".join(difflib.unified_diff(old, new, "stored", name, lineterm="", n=1)))
    if arguments.store:
        store(current)
        return 0
    return int(changed)


if __name__ == "__main__":
    raise SystemExit(main())
