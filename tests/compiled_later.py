"""Kernels that are compiled after a warm-up, detected in a process without other kernels."""

import json

from tests.run_python import run_python

SCRIPT = """
import json, sys
from numba.core.dispatcher import Dispatcher
{imports}

def kernels():
    names = [name for name in sys.modules if name.startswith("foldback.planner.kernels.")]
    return {{
        f"{{name}}.{{kernel}}": len(found.signatures)
        for name in names
        for kernel, found in vars(sys.modules[name]).items()
        if isinstance(found, Dispatcher)
    }}

warm_up()
before = kernels()
{work}
print(json.dumps([name for name, count in kernels().items() if count != before.get(name, 0)]))
"""


def compiled_later(imports: str, work: str, *arguments: str) -> list[str]:
    """Return the names of the kernels that ``work`` compiles although ``warm_up`` ran before.

    Args:
        imports: Code that imports ``warm_up`` and the names that ``work`` needs.
        work: Code to run after the warm-up.
        arguments: Values of its ``sys.argv[1:]``.
    """
    output = run_python("-c", SCRIPT.format(imports=imports, work=work), *arguments)
    return json.loads(output.splitlines()[-1])
