"""docs/modules.md and the schema that it links to."""

import json
import re

from docs.make_module_schema import FILE, schema_text
from foldback.planner.chain.module_checks import check_module
from foldback.planner.chain.module_file import read_module
from tests.run_python import ROOT

PAGE = (ROOT / "docs" / "modules.md").read_text(encoding="utf-8")


def test_schema_is_up_to_date() -> None:
    assert FILE.read_text(encoding="utf-8") == schema_text(), "python -m docs.make_module_schema"


def test_example_has_no_faults() -> None:
    (example,) = re.findall(r"```json\n(.*?)```", PAGE, re.S)
    module = read_module(json.loads(example))
    check_module(module)
    assert module.pitch_m == 0.01


def test_every_fault_is_listed() -> None:
    source = ROOT.joinpath("planner", "chain", "module_checks.py").read_text(encoding="utf-8")
    codes = set(re.findall(r'(?:_fault|InputError)\(\s*"([a-z-]+)"', source))
    assert codes
    assert codes | {"bad-module"} == set(re.findall(r"^\| `([a-z-]+)`", PAGE, re.M))
