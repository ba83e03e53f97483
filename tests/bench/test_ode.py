"""The published algorithm on ODE: its equations, its input, and the figures that are shown."""

import re
import subprocess
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bench.ode.comparison import OWN, SOLVERS, Comparison
from bench.ode.program import SOURCE, OdeMissingError, Solver, find_compiler, input_text, ode_flags
from bench.ode.texts import METHODS, README, page_section, readme
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.core import near_pairs, repulsion
from foldback.planner.explosion.loop.explosion_loop import UNREPELLED_LINKS

FORCES_PROGRAM = """
#include <cstdio>
#include "forces.hpp"
int main() {
  std::vector<published::Vector> p, f;
  published::Vector v;
  while (std::scanf("%lf %lf %lf", &v[0], &v[1], &v[2]) == 3) p.push_back(v);
  f.resize(p.size());
  published::explosion_forces(p, {0.1, 1.0, 1.0, 2.5}, f);
  for (const auto& u : f) std::printf("%.17g %.17g %.17g\\n", u[0], u[1], u[2]);
}
"""


def test_equations_in_cpp_agree_with_those_of_the_planner(tmp_path: Path) -> None:
    """Equations 1 to 3 in C++ need no ODE."""
    steps = np.random.default_rng(0).normal(size=(40, 3))
    points = np.cumsum(steps / np.linalg.norm(steps, axis=1, keepdims=True), axis=0)
    (tmp_path / "forces.cpp").write_text(FORCES_PROGRAM)
    program = tmp_path / "forces"
    command = [find_compiler(), "-std=c++20", f"-I{SOURCE.parent}", tmp_path / "forces.cpp"]
    subprocess.run([*command, "-o", program], check=True)
    text = "\n".join(" ".join(map(repr, point)) for point in points.tolist())
    answer = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    forces = np.array(answer.stdout.split(), dtype=float).reshape(points.shape)

    expected = 0.1 * (points - points.mean(axis=0))
    pairs = near_pairs(points, 2.5, UNREPELLED_LINKS + 1)
    assert len(pairs) > 20
    repulsion(points, pairs, 1.0, expected)
    np.testing.assert_allclose(forces, expected, rtol=1e-12, atol=1e-12)


def test_input_has_exactly_the_values_that_the_program_reads() -> None:
    chain = Chain.from_path(CellPath.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)]))
    solver = Solver(explosion_iterations=7, playback_iterations=0, steps_per_snapshot=3)
    lines = input_text(chain, solver).splitlines()
    values = dict(line.split() for line in lines[: -len(chain) - 1])
    assert set(re.findall(r'input\("(\w+)"\)', SOURCE.read_text())) == set(values)
    assert (values["explosion_iterations"], values["radial_gain"]) == ("7", "0.1")
    assert lines[-len(chain) - 1] == f"modules {len(chain)}"
    poses = np.array([line.split() for line in lines[-len(chain) :]], dtype=float)
    np.testing.assert_array_equal(poses[:, :3], chain.folded_poses.positions)
    np.testing.assert_array_equal(poses[:, 3:].reshape(-1, 3, 3), chain.folded_poses.rotations)


def test_missing_programs_and_libraries_are_named_with_the_remedy(tmp_path: Path) -> None:
    empty = {"PATH": str(tmp_path), "CXX": "", "PKG_CONFIG_LIBDIR": str(tmp_path)}
    with pytest.raises(OdeMissingError, match="apt install g\\+\\+"):
        find_compiler(empty)
    with pytest.raises(OdeMissingError, match="apt install pkg-config libode-dev"):
        ode_flags(empty)


def test_stored_figures_are_complete_and_shown() -> None:
    comparison = Comparison.load()
    assert {row.id for row in comparison.rows} == {OWN, *SOLVERS} == set(METHODS)
    own = comparison.row(OWN)
    assert own.status == "folded" and own.size is not None
    for name, solver in SOLVERS.items():
        row = comparison.row(name)
        assert row.status == "folded"
        assert row.playback_steps >= solver.steps_per_snapshot * row.explosion_steps / 10
        assert row.references > own.references > 0.0 and row.lag_rad > own.lag_rad > 0.0
    assert all(len(row) == len(page_section()["head"]) for row in page_section()["rows"])
    text = README.read_text(encoding="utf-8")
    assert text == readme(text)  # ``python -m bench.ode --tell`` writes it


def test_stored_figures_are_read_back_as_they_were_written(tmp_path: Path) -> None:
    comparison = Comparison.load()
    comparison.save(tmp_path / "ode.json")
    assert Comparison.load(tmp_path / "ode.json") == comparison
    assert {"rows", "machine", "date"} == {field.name for field in fields(comparison)}
