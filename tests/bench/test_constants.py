import pytest

from bench.constants.counting import numeric_constants
from bench.constants.varying import NUMBERS, varied
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.playback import reference_curve, window_trajectory
from tests.case import case


def test_each_number_of_the_table_can_be_varied() -> None:
    for homes in NUMBERS.values():
        for home, names in homes.items():
            for name in names:
                with case(f"{home.__name__}: {name}"), varied(home, name, 1.4) as value:
                    assert value


def test_a_varied_constant_changes_where_it_is_imported_and_returns() -> None:
    homes = (reference_curve, window_trajectory)
    usual = [home.REFERENCE_CLEARANCE_PITCH for home in homes]
    with pytest.raises(ZeroDivisionError), varied(homes[0], "REFERENCE_CLEARANCE_PITCH", 0.5):
        assert [home.REFERENCE_CLEARANCE_PITCH for home in homes] == [0.5 * step for step in usual]
        raise ZeroDivisionError
    assert [home.REFERENCE_CLEARANCE_PITCH for home in homes] == usual


def test_a_varied_parameter_is_the_default() -> None:
    usual = ExplosionParameters()
    with varied(ExplosionParameters, "drag", 2.0):
        assert ExplosionParameters().drag == (2.0 * usual.drag[0], 2.0 * usual.drag[1])
    assert ExplosionParameters() == usual


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("A = 3\nB: Final = -2.5 * 1e3\n_C = (1, 2)\n", ["A", "B", "_C"]),
        ("A = 60 * MINUTE\nB = {'x': 1.0}\n", ["A", "B"]),
        ("A = 'text'\nB = True\nlower = 3\nC = ('x', 1)\n", []),
        ("A = B\nC = (A, B)\nD = b'x'.ljust(80)\nE = np.array([1, 2])\n", ["E"]),
        ("def function():\n    A = 3\n", []),
    ],
)
def test_numeric_constants_are_counted(source: str, names: list[str]) -> None:
    assert list(numeric_constants(source)) == names
