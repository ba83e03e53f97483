"""Wrong calls of the compiled core raise exceptions."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from foldback.planner import core
from tests.planner.core.wrong_calls import FUNCTIONS

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_wrong_arguments_are_refused_and_wrong_shapes_do_not_crash() -> None:
    program = [sys.executable, "-m", "tests.planner.core.wrong_calls"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    # The last line names the call that crashed.
    assert done.returncode == 0, (done.returncode, done.stdout[-200:], done.stderr)
    result = json.loads(done.stdout.splitlines()[-1])
    assert len(result["called"]) >= 15
    assert result["accepted"] == []
    assert result["others"] == []


@pytest.mark.parametrize("name", FUNCTIONS)
def test_calls_with_too_few_or_no_usable_arguments_are_refused(name: str) -> None:
    function = getattr(core, name)
    ((signature, *_),) = function.__nb_signature__
    for count in (0, signature.count(": ")):
        with pytest.raises(TypeError, match=name):
            function(*[None] * count)
