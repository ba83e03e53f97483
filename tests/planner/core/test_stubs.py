"""Types of the core, as ``_core.pyi`` describes them, against the compiled module."""

import ast
import re
from pathlib import Path

from foldback.planner import core
from foldback.planner.core import _core

STUBS = ast.parse((Path(core.__file__).parent / "_core.pyi").read_text())


def described_functions() -> dict[str, list[str]]:
    """Return the names of arguments of all functions in the stubs, by function."""
    functions = [node for node in STUBS.body if isinstance(node, ast.FunctionDef)]
    return {node.name: [argument.arg for argument in node.args.args] for node in functions}


def compiled_functions() -> dict[str, list[str]]:
    """Return the names of arguments of all functions in the compiled module, by function."""
    signatures = {}
    for name, function in vars(_core).items():
        if callable(function) and not name.startswith("__") and not isinstance(function, type):
            ((signature, *_),) = function.__nb_signature__
            signatures[name] = re.findall(r"(\w+): ", signature)
    return signatures


def test_stubs_and_compiled_module_have_the_same_functions() -> None:
    assert described_functions() == compiled_functions()


def test_stubs_and_compiled_module_have_the_same_classes() -> None:
    described = {
        node.name: {f.name for f in node.body if isinstance(f, ast.FunctionDef)} - {"__init__"}
        for node in STUBS.body
        if isinstance(node, ast.ClassDef)
    }
    compiled = {
        name: {method for method in vars(value) if not method.startswith("__")}
        for name, value in vars(_core).items()
        if isinstance(value, type)
    }
    assert described == compiled


def test_stubs_and_compiled_module_have_the_same_constants() -> None:
    described = {node.target.id for node in STUBS.body if isinstance(node, ast.AnnAssign)}
    compiled = {name for name, value in vars(_core).items() if isinstance(value, int | float)}
    assert described == compiled


def test_package_names_all_that_is_compiled() -> None:
    described = {*described_functions(), *(vars(_core).keys() & vars(core).keys())}
    assert set(core.__all__) == {name for name in described if not name.startswith("__")}
