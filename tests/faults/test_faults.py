from collections import Counter
from pathlib import Path

import pytest

from tests.case import case
from tests.faults.fault import Fault, StaleFaultError, all_faults

ROOT = Path(__file__).parents[2]
FAULTS = all_faults()


def test_faults_apply_to_the_code() -> None:
    for fault in FAULTS:
        with case(fault.name):
            before = (ROOT / fault.file).read_text(encoding="utf-8")
            after = fault.apply(before)
            assert after != before
            if fault.file.endswith(".py"):
                compile(after, fault.file, "exec")


def test_likely_tests_of_faults_exist() -> None:
    for fault in FAULTS:
        with case(fault.name):
            files = [
                Path(word.partition("::")[0]) for word in fault.likely if word.startswith("tests/")
            ]
            assert files
            assert all((ROOT / file).is_file() for file in files)


def test_fault_names_are_unique() -> None:
    assert not [name for name, count in Counter(f.name for f in FAULTS).items() if count > 1]


@pytest.mark.parametrize("text", ["a = 2", "a = 1; b = 1"])
def test_stale_fault_is_an_error(text: str) -> None:
    fault = Fault(name="one", breaks="all", file="a.py", old="= 1", new="= 0", likely=("tests/a",))
    with pytest.raises(StaleFaultError, match=r"one: got its old text \d times in a.py"):
        fault.apply(text)
