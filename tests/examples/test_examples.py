import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("[0-9][0-9]_*.py"))
WITH_A_SERVICE = {"06_drive_a_robot", "07_fold_by_api"}
"""Examples that need a running service; tests/server runs them."""
LONG = {
    *("00_fold_a_path", "03_explode_a_chain", "04_follow_a_timeline"),
    *("05_draw_a_shape", "08_show_in_viser"),
}
"""Examples that take seconds; `make test-long` runs them."""
ALONE = [
    pytest.param(script, marks=[pytest.mark.long] * (script.stem in LONG), id=script.stem)
    for script in SCRIPTS
    if script.stem not in WITH_A_SERVICE
]


@pytest.mark.parametrize("script", ALONE)
def test_example_runs_as_it_stands(script: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)],
        cwd=tmp_path,
        env={"PYTHONPATH": str(EXAMPLES.parent), "PATH": "", "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_examples_are_short_and_numbered() -> None:
    numbers = [int(script.name[:2]) for script in SCRIPTS]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    for script in SCRIPTS:
        assert len(script.read_text(encoding="utf-8").splitlines()) < 70, script
