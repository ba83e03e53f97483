"""Specifications of sweeps: what can be said, and what is refused in a sentence."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from foldback.planner.errors import InputError
from foldback.planner.sweeps.cases import series_of
from foldback.planner.sweeps.spec import SweepSpec, bytes_of, seeds_of
from foldback.planner.sweeps.sweep import SweepState
from tests.case import case
from tests.refusal import refused

SPEC = """
shapes = ["gallery:*-24", "parts/*.json"]
seeds = "0-1"
[budget]
cpu_s = 60
memory = "1 GiB"
[methods.auto]
[methods.paper]
preset = "paper"
seeds = [7]
only = "wrench-*"
budget.cpu_s = 900
[grid]
module_size = [0.90, 0.95]
[keep]
plans = "failed"
"""
NUMBERS = list(range(1, 1000))
BAD = (
    ("shapes = [", "got no TOML"),
    ('shapes = ["gallery:*"]\nseds = 3', "unknown key 'seds', expected seeds"),
    ('shapes = ["gallery:*"]\nseeds = "1 to 4"', "got the seeds '1 to 4', expected a number"),
    ('shapes = ["wrench-25"]', "'wrench-25', which no shape matches.*wrench-24"),
    ('shapes = ["gallery:none-*"]', "which no shape matches"),
    ("seeds = 3", "got no shapes"),
    ('shapes = ["gallery:*"]\nbudget.memory = "a lot"', "got the memory 'a lot', expected a size"),
    ('shapes = ["gallery:*"]\nbudget.wall_s = 0', "expected more than 0"),
    (
        'shapes = ["gallery:*"]\nbudget.wall = 9',
        "budget: got the unknown key 'wall', expected wall_s",
    ),
    ('shapes = ["gallery:*"]\nkeep.plans = "some"', "keep.plans"),
    ('shapes = ["gallery:*"]\nuntil = "failed"', "until"),
    (
        'shapes = ["gallery:*"]\nmethods.a.presett = "paper"',
        "methods.a: .*'presett', expected preset",
    ),
    ('shapes = ["gallery:*-24"]\nmethods.a.preset = "papers"', "got the preset 'papers'"),
    ('shapes = ["gallery:*-24"]\nmethods.a.repair = "yes"', "bool"),
    ('shapes = ["gallery:*"]\ngrid.sed = [1]', "grid: got the unknown key"),
    ('shapes.a.only = "x"', "shapes.a"),
    ("shapes = [[1]]", "shapes"),
    ('shapes = "gallery:*"\nmethods = 3', "got methods of type int, expected a table"),
    ('shapes = "gallery:*"\nbudget.cpu_s = 1e300', "and at most 1e[+]15 of each"),
    (f"shapes = {'[' * 20_000}", "nested more deeply"),
    (f'shapes = "gallery:*-24"\nmethods.a.settings.{".".join("b" * 3000)} = 1', "recursion"),
    ('shapes = "gallery:*"\ngrid.module_size = []', "got a spec of 0 folds"),
    ('shapes = "gallery:*"\nmethods.a.only = "none"', "got a spec of 0 folds"),
    ('shapes = "gallery:*"\nseeds = "0-4294967295"', "folds, expected at most 1000000"),
    (
        f'shapes = "gallery:*"\ngrid.modules = {NUMBERS}\ngrid.at_once = {NUMBERS}',
        "folds, expected at most 1000000",
    ),
)


def _cases(tmp_path: Path, **values: Any) -> list[Any]:
    return list(SweepState.of(SweepSpec.of(values, tmp_path), tmp_path).missing())


def test_spec_gives_every_fold_once(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "bar.json").write_text("[[0,0,0],[1,0,0],[2,0,0]]")
    (tmp_path / "sweep.toml").write_text(SPEC)
    spec = SweepSpec.from_toml(tmp_path / "sweep.toml")
    cases = list(SweepState.of(spec, tmp_path).missing())
    rows = [
        (c.columns["shape"], c.columns["method"], c.columns["seed"], c.columns["module_size_pitch"])
        for c in cases
    ]
    auto = {
        (shape, "auto", seed, size)
        for shape in ("mallet-24", "wrench-24", "parts/bar")
        for seed in (0, 1)
        for size in (0.90, 0.95)
    }
    assert set(rows) == auto | {("wrench-24", "paper", 7, size) for size in (0.90, 0.95)}
    assert len(rows) == len({c.key for c in cases}) == 14
    assert [row[2] for row in rows[-6:]] == [1] * 6, "second seeds come after all first ones"
    assert rows[0][0] == "parts/bar", "the cheapest first"
    limits = {str(c.columns["method"]): c.limits for c in cases}
    assert limits["paper"].cpu_s == 900.0
    assert limits["auto"].cpu_s == 60.0
    assert limits["auto"].memory_bytes == 2**30


def test_spec_in_a_directory_is_the_same(tmp_path: Path) -> None:
    values = {
        "shapes": {"small": {"files": ["gallery:*-24"], "seeds": range(3)}, "bar": "bar.json"},
        "methods": {"peel": {"strategy": "peel", "budget": {"wall_s": 5}}},
    }
    spec = SweepSpec.of(values, tmp_path)
    (tmp_path / "sweep.toml").write_text(tomli_w.dumps(spec.as_dict()))
    assert SweepSpec.from_toml(tmp_path / "sweep.toml") == spec


def test_bad_specs_are_refused_in_a_sentence(tmp_path: Path) -> None:
    for text, match in BAD:
        (tmp_path / "sweep.toml").write_text(text)
        with case(text[:80]), pytest.raises(InputError, match=match):
            series_of(SweepSpec.from_toml(tmp_path / "sweep.toml"))


def test_file_is_one_shape_however_links_lead_to_it(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "bar.json").write_text("[[0,0,0],[1,0,0],[2,0,0]]")
    (tmp_path / "parts" / "again").symlink_to(tmp_path)
    cases = _cases(tmp_path, shapes=["**/*.json"])
    assert [fold.columns["shape"] for fold in cases] == ["parts/bar"]


def test_seeds_and_memory() -> None:
    assert list(seeds_of("0-2", "a")) == [0, 1, 2]
    assert list(seeds_of([1, 5, 1], "a")) == [1, 5]
    assert list(seeds_of("name", "random-32-17")) == [17]
    with refused("bad-seeds", match="without a number"):
        seeds_of("name", "wrench")
    for text, count in (("2 GiB", 2 * 2**30), ("1.5MB", 1_500_000), ("512", 512), (9, 9)):
        assert bytes_of(text) == count


def test_keys_change_with_the_bytes_of_a_shape_alone(tmp_path: Path) -> None:
    bars = [b"[[0,0,0],[1,0,0]]", b"[[0,0,0],[1,0,0]]", b"[[0,0,0],[0,1,0]]"]
    keys = [_cases(tmp_path, shapes=[("bar.json", data)])[0].key for data in bars]
    assert keys[0] == keys[1] != keys[2]


def test_a_larger_spec_has_the_keys_of_a_smaller_one(tmp_path: Path) -> None:
    methods = {"auto": {}, "peel": {"strategy": "peel"}}
    small = _cases(tmp_path, shapes=["gallery:wrench-24"], seeds="0-1")
    large = _cases(tmp_path, shapes=["gallery:*-24"], seeds="0-3", methods=methods)
    assert {fold.key for fold in small} < {fold.key for fold in large}
    assert len({fold.key for fold in large}) == 16
