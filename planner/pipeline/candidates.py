"""Candidates: the chains that a fold may try, as its directory keeps them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final

from planner.chain.chain import Chain
from planner.files import write_json
from planner.motion.timeline import chain_attributes, chain_from_attributes
from planner.pipeline.portfolio import Try

FILE: Final = "candidates.json"


@dataclass(frozen=True, slots=True)
class Candidates:
    """Chains through the same shape.

    Attributes:
        chains: The likeliest first.
        two_ended: Whether they may as well begin at their other end.
    """

    chains: tuple[Chain, ...]
    two_ended: bool

    @classmethod
    def load(cls, directory: FilePath) -> Candidates:
        """Those of the fold in a directory."""
        values: Any = json.loads((directory / FILE).read_bytes())
        if isinstance(values, list):  # of a fold that was read before there were other ends
            values = {"chains": values, "two_ended": False}
        chains = tuple(chain_from_attributes(attributes) for attributes in values["chains"])
        return cls(chains, values["two_ended"])

    def save(self, directory: FilePath) -> None:
        """Keeps them in a fold's directory."""
        chains = [chain_attributes(chain) for chain in self.chains]
        values = {"chains": chains, "two_ended": self.two_ended}
        write_json(directory / FILE, values)

    def chain_of(self, todo: Try) -> Chain:
        """The chain of a try."""
        chain = self.chains[todo.candidate]
        return chain.from_other_end() if todo.other_end else chain
