"""``python -m tests.faults [NAME …] [--all]``: report the test that finds each fault.

Each fault is made in a copy of the checkout, and tests are run there until one fails: first those
that should find it, then, with ``--all``, the whole suite. The test that failed is run again
without the fault, where it must pass.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tests.faults.fault import Fault, all_faults
from tests.faults.scratch import FAILED_TESTS, PASSED, Scratch

CHECKOUT: Final = Path(__file__).parents[2]
LIKELY_TIMEOUT_S: Final = 900.0
ALL_TIMEOUT_S: Final = 2 * 3600.0
WHOLE_SUITE: Final = ("--ignore=tests/faults",)
"""Pytest arguments for the whole suite, without the test that requires code without faults."""
Outcome = Literal["found", "not found", "no end", "unsound"]
SUCCESSES: Final = ("found", "no end")
MAX_OUTPUT_CHARACTERS: Final = 4000


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of one fault.

    Attributes:
        fault: Name of the fault.
        breaks: Behaviour that is wrong with it.
        outcome: ``found``, ``not found``, ``no end`` if tests did not end, which is a failure as
            well, or ``unsound`` if they also fail without the fault or could not be run.
        found_by: Test that failed.
        part: ``likely`` or ``all``: the tests that it was run with.
        output: End of pytest's output if the outcome is unsound.
        seconds: Wall time, s.
    """

    fault: str
    breaks: str
    outcome: Outcome
    found_by: str | None
    part: str | None
    output: str
    seconds: float


def main() -> int:
    """Try the requested faults; return 1 unless each is found."""
    faults = {fault.name: fault for fault in all_faults()}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="of faults; all when none is told")
    parser.add_argument("--all", action="store_true", help="run all tests when likely ones pass")
    parser.add_argument("--out", type=Path, default=Path("out/faults.json"))
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - faults.keys():
        parser.error(f"got {', '.join(sorted(unknown))}, expected some of {', '.join(faults)}")
    chosen_faults = [faults[name] for name in arguments.names or faults]
    console = Console(width=max(140, Console().width))
    answers: list[Answer] = []
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    with tempfile.TemporaryDirectory(prefix="faults-") as work_dir:
        scratch = Scratch(CHECKOUT, Path(work_dir))
        for fault in chosen_faults:
            start = time.perf_counter()
            outcome = _try(scratch, fault, all_tests=arguments.all)
            seconds = round(time.perf_counter() - start, 1)
            answers.append(answer := Answer(fault.name, fault.breaks, *outcome, seconds))
            print(f"{answer.fault}: {_words(answer)} ({answer.seconds:.0f} s)", flush=True)
            if answer.output:
                print(answer.output, flush=True)
    _write(arguments.out, answers)
    _show(console, answers)
    return 0 if all(answer.outcome in SUCCESSES for answer in answers) else 1


def _try(
    scratch: Scratch, fault: Fault, *, all_tests: bool
) -> tuple[Outcome, str | None, str | None, str]:
    parts = [("likely", fault.likely, LIKELY_TIMEOUT_S), ("all", WHOLE_SUITE, ALL_TIMEOUT_S)]
    for part, tests, seconds in parts if all_tests else parts[:1]:
        with scratch.with_fault(fault):
            run = scratch.run_tests(tests, seconds=seconds)
        if run.code is None:
            return "no end", None, part, ""
        if run.code == FAILED_TESTS and run.failed:
            repeated_run = scratch.run_tests(run.failed[:1], seconds=seconds)
            if repeated_run.code != PASSED:
                return "unsound", run.failed[0], part, repeated_run.output[-MAX_OUTPUT_CHARACTERS:]
            return "found", run.failed[0], part, ""
        if run.code != PASSED:
            return "unsound", None, part, run.output[-MAX_OUTPUT_CHARACTERS:]
    return "not found", None, None, ""


def _words(answer: Answer) -> str:
    among = f" ({answer.part})" if answer.part == "all" else ""
    return f"{answer.outcome} {answer.found_by or ''}{among}".strip()


def _show(console: Console, answers: list[Answer]) -> None:
    table = Table()
    for title in ("fault", "what it breaks", "found by"):
        table.add_column(title, overflow="fold")
    table.add_column("s", justify="right")
    for answer in answers:
        computed_escape = escape(_words(answer).removeprefix("found "))
        table.add_row(answer.fault, answer.breaks, computed_escape, f"{answer.seconds:.0f}")
    console.print(table)
    is_met = sum(answer.outcome in SUCCESSES for answer in answers)
    console.print(f"{is_met} of {len(answers)} faults are found.")


def _write(path: Path, answers: list[Answer]) -> None:
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    report = {
        "date": time.strftime("%Y-%m-%d"),
        "commit": commit.stdout.strip(),
        "faults": [asdict(answer) for answer in answers],
    }
    path.write_text(json.dumps(report, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    raise SystemExit(main())
