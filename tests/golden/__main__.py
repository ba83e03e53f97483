"""``python -m tests.golden [NAME …] [--store]``: list changes of the results of small folds.

With ``--store``, the results become the expected ones of this machine. Store them only at a commit
whose change of results is intended, and say in its message which parts change and why.
"""

import argparse

from tests.golden.cases import CASES
from tests.golden.digests import changed_parts
from tests.golden.store import compute, load, save, summary_differences


def main() -> int:
    """Compare or store the results of the named cases; return 1 if one of them has changed."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="cases; default: all")
    parser.add_argument("--store", action="store_true", help="store the results of this machine")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - CASES.keys():
        parser.error(f"got {', '.join(sorted(unknown))}, expected some of {', '.join(CASES)}")
    results = {name: compute(name) for name in arguments.names or CASES}
    any_changed = False
    for name, result in results.items():
        own_values, everywhere = load(name)
        changed = [] if own_values is None else changed_parts(own_values.digests, result.digests)
        for reference in everywhere[:1] if own_values is None else [own_values]:
            changed += summary_differences(reference.summary, result.summary)
        any_changed |= bool(changed)
        expected = (
            "this machine" if own_values else "another machine" if everywhere else "no machine"
        )
        print(f"{name}: {len(changed)} differences from the results stored for {expected}")
        print("".join(f"  {changed_path}\n" for changed_path in changed), end="")
    if arguments.store:
        print(f"Stored in {save(results)}.")
        return 0
    return int(any_changed)


if __name__ == "__main__":
    raise SystemExit(main())
