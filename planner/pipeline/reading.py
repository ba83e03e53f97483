"""Reading: from the bytes of an input to the chains that a fold may explode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from foldback.planner.chain.built_in_modules import described_words
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.explosion.strategies import on_lattice, ranked_strategies
from foldback.planner.pipeline.attempt import Candidates
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.pipeline.request import PATH_SEED_MODULUS, FoldRequest
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.prepared_chains import PreparedChains
from foldback.planner.playback.unfolding import check_fits
from foldback.planner.turns.step_turning import unwound


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Result of the stage ``read``.

    Attributes:
        candidates: Chains that may be folded.
        kind: ``path``, ``chain``, ``voxels``, ``mesh`` or ``plan``: what the input was.
        method: Method that found the paths; None for a plan.
        notes: Notes for users.
        knot: Verdict on the knot of the first candidate; None without one.
    """

    candidates: Candidates
    kind: str
    method: str | None = None
    notes: Sequence[str] = ()
    knot: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        chain, likenesses = self.candidates.chains[0], self.candidates.likenesses
        return {
            "kind": self.kind,
            "method": self.method,
            "notes": list(self.notes),
            "knot": self.knot,
            "candidates": len(self.candidates.chains),
            "likeness": likenesses[0].as_dict() if likenesses else None,
            "name": chain.name,
            "module": chain.module.name,
            "module_words": described_words(chain.module),
            "modules": len(chain),
            "joints": chain.joint_count,
            "hinges": len(chain.folded_rad),
            "pitch_m": chain.pitch_m,
        }


def read_plan(recorded: Plan) -> Reading:
    """Return the chain of a plan that is smoothed.

    Raises:
        InputError: When it cannot be smoothed.
    """
    from foldback.planner.smoothing.smoothed_plan import check_smoothable  # late: rarely needed

    check_smoothable(recorded)
    likenesses = () if recorded.likeness is None else (recorded.likeness,)
    candidates = Candidates((recorded.chain,), two_ended=False, likenesses=likenesses)
    return Reading(candidates=candidates, kind="plan")


def read_shape(
    request: FoldRequest,
    shape: Path | Chain | bytes,
    *,
    start: Chain | None = None,
    prepared: PreparedChains | None = None,
) -> Reading:
    """Return the chains that fold into a shape, and how they were found.

    Args:
        request: Request of the fold.
        shape: The shape, or the bytes of its file.
        start: Chain as it is folded at the beginning of a refold; None for other folds.
        prepared: Chains that a preview has found with the same request; None to search for them.

    Raises:
        InputError: When the input cannot be used.
    """
    if prepared is None:
        seed = request.seed % PATH_SEED_MODULUS
        prepared = prepare(shape, request.filename, request.path_options(), seed=seed).prepared()
    parameters = request.parameters(prepared.chains[0].module)
    chains = tuple(
        unwound(chain, module_size=parameters.module_size, seed=request.seed)
        for chain in prepared.chains
    )
    chain, likenesses = chains[0], prepared.likenesses
    if start is not None:
        # A fitted path may have fewer modules; the path through blocks may still fit.
        chain = next((chain for chain in chains if len(chain) == len(start)), chain)
        check_fits(start, chain.module, len(chain))
        # It is the same chain, whatever size the other shape was drawn in.
        fitting = [k for k, candidate in enumerate(chains) if len(candidate) == len(start)]
        chains = tuple(replace(chains[k], pitch_m=start.pitch_m) for k in fitting)
        likenesses = tuple(likenesses[k] for k in fitting) if likenesses else ()
        chain = chains[0]
    ranked_strategies(chain, parameters, refolds=request.refold)  # or it is refused
    # A chain comes as it is wanted; what only shows cells may as well begin at their other end.
    is_fixed = prepared.kind == "chain" or request.start is not None or request.refold
    is_fixed = is_fixed or request.world == "table"  # whose path begins on it
    return Reading(
        candidates=Candidates(
            chains, two_ended=not is_fixed and on_lattice(chain), likenesses=likenesses
        ),
        kind=prepared.kind,
        method=prepared.method,
        notes=prepared.notes,
        knot=prepared.knot,
    )
