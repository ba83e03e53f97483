"""Refusals of the command line: exit code 2, a message with the remedy, and no results.

``test_parameters.py`` has the options of a fold, and ``test_settings.py`` those of the service.
"""

import shlex
from pathlib import Path

import pytest

from tests.case import case
from tests.server.cli.test_command_line import foldback
from tests.server.cli.test_table import write_plan

SERVOS = "servos --torque 4 --pitch-mm 40"
REFUSALS = {
    "unfold": "No such command 'unfold'",
    "verify nowhere": "Folder not found",
    "verify file": "no zip archive",
    "verify file --largest-size": "expected the whole folder",
    "fold --out out": "got nothing to fold, expected one of INPUT",
    "fold wrench-24 --angles '- - - +' --out out": "got INPUT and --angles, expected one of INPUT",
    "fold wrench-24 --module sphere --out out": "a module file, or one of: cube, tetrahedron",
    "fold --angles '0 - x +' --out out": "character 5: got x after 2 angles",
    "fold --word '漢字' --out out": "there is no block letter for “漢”",
    "fold word:abcdefghijklm --out out": "got 13 letters, expected 1 to 12",
    f"{SERVOS} --material wood": "expected aluminium",
    f"{SERVOS} --servo mx28": "MX-28AT",
    f"{SERVOS} --shape =3": "NAME=TORQUE",
    f"{SERVOS} --shape a=-3": "got a torque of -3",
    f"{SERVOS} --share 2": "got a share of 2",
    f"{SERVOS} --mass-g 0": "got a module of 0 kg",
    f"{SERVOS} --pitch-mm 0": "got a pitch of 0",
    f"{SERVOS} --plan empty": "got a folder without plan.npz",
    "table plan --base held": "expected clamped or free",
    "table plan --friction=-1": "friction: got -1",
    "table plan --pitch-mm 0": "pitch_m: got 0",
    "table empty": "got no plan",
    "export empty --as urdf,dae --out out": "'dae', expected one of: json, npz",
    "export empty --out out": "got a folder without plan.npz",
    "smooth empty --out out": "got a folder without plan.npz",
    "smooth plan --out plan": "expected another directory",
    "refold empty hammer --out out": "got a folder without plan.npz",
    "refold wrench-160 hammer --out out": "these examples fit: axe, mallet-160",
    "movie plan --out fold.avi": ".mp4 or .gif",
    "movie plan --out fold.gif --width 65": "expected an even number",
    "movie plan --out none/fold.mp4": "the folder for the movie does not exist",
    "movie empty --out fold.mp4 --tour": "got a folder without plan.npz",
    "retime plan --out robot.txt --max-speed 1 --max-acceleration 1": "ends in .csv or .json",
    "site out --no-finished": "got no folds",
    "site out --no-finished --folds nothing-here": "found no fold at this path",
    "site out --no-finished --service javascript:alert(1)": "expected an address",
    "site out --no-finished --service https://": "expected an address",
}
"""Words of the message for each command, in a directory with a file, a plan and an empty folder."""


def test_command_line_refuses_wrong_input_and_writes_no_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("empty", "plan"):
        (tmp_path / name).mkdir()
    write_plan(tmp_path / "plan")
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    for command, words in REFUSALS.items():
        with case(command):
            answer = foldback(*shlex.split(command))
            assert answer.returncode == 2
            assert words in " ".join(answer.stderr.split())
            assert sorted(tmp_path.rglob("*")) == before
