"""``foldback verdict``: whether turns lead to a figure, each answer with its proof."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import bytes_of, read_input, refuse
from foldback.cli.options import AsJson
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.reachability.deciding import Decider
from foldback.planner.reachability.exhaustion_file import write_exhaustion
from foldback.planner.reachability.verdict import Verdict
from foldback.planner.readers import read
from foldback.planner.storage.files import write_whole
from foldback.words.reachability import CHECK_HINT, verdict_lines


def verdict(
    *,
    figure: Annotated[
        str,
        typer.Argument(
            metavar="FIGURE",
            help="Code or name of a figure of a Rubik's snake, or file with a chain.",
        ),
    ],
    goal: Annotated[
        str | None,
        typer.Option("--from", metavar="FIGURE", help="Figure to begin with. Default: straight."),
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(
            "--file",
            metavar="OUT",
            help="Output file for the proof that there are no single turns, if that is so.",
        ),
    ] = None,
    sizes: Annotated[
        bool,
        typer.Option(help="Find the largest size of the modules, if full size does not do."),
    ] = True,
    seed: Annotated[int, typer.Option(help="Random seed.", min=0)] = 0,
    as_json: AsJson = False,
) -> None:
    """Say whether turns of joints lead to a figure.

    Exits with 0 if turns at full size or for smaller modules are known, with 3 if none are, and
    with 2 if the input is bad.
    """
    try:
        chain = _chain(figure)
        start = None if goal is None else _chain(goal)
        if start is not None and (start.module, len(start)) != (chain.module, len(chain)):
            raise InputError(
                "refold-differs",
                f"got figures of {len(start)} {start.module.words.plural} and {len(chain)} "
                f"{chain.module.words.plural}, expected the same modules and as many of them.",
            )
        decider = Decider(
            chain.module,
            chain.folded_rad,
            None if start is None else start.folded_rad,
            seed=seed,
        )
        decision = decider.verdict(sizes=sizes)
        _write_proof(chain, decision, file)
    except InputError as error:
        refuse(error, as_json)
    except OSError as error:
        problem = f"cannot be written ({error.strerror})."
        refuse(InputError("no-file", problem, where=str(file)), as_json)
    lines = verdict_lines(decision.figures(), chain.module)
    if as_json:
        print(json.dumps({"text": lines, **decision.report()}), flush=True)
    else:
        print("\n".join(lines))
        if file is not None and decision.exhaustion is not None:
            print(CHECK_HINT.format(file=file))
    if decision.sequence is None:
        raise typer.Exit(NOT_ACHIEVED)


def _chain(figure: str) -> Chain:
    """Return the chain of a code, a name or a file."""
    path = Path(figure)
    if path.is_file():
        data, name = bytes_of(path), path.name
    else:
        data, name = read_input(None, snake=figure)
    chain = read(data, filename=name)
    if not isinstance(chain, Chain):
        raise InputError(
            "no-chain", "got an input without joint angles, expected a chain.", where=name
        )
    return chain


def _write_proof(chain: Chain, decision: Verdict, file: Path | None) -> None:
    if file is not None and decision.exhaustion is not None:
        proof = write_exhaustion(
            chain.module, decision.exhaustion, figure=decision.figure, goal=decision.goal
        )
        write_whole(file, proof)
