"""Prepared chains: a path search's result in a file, so that a fold need not repeat its preview's.

The file holds the digest of the input and of all options. Chains of another input, of other options
or of another version are not used.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path as FilePath
from typing import Any, Self

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.planner.errors import UNREADABLE
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.storage.file_names import PREPARED
from foldback.planner.storage.files import write_json
from foldback.planner.storage.plain_values import from_plain


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedChains:
    """Chains through the shape in an input.

    Attributes:
        kind, method, notes: Same as for ``planner.pipeline.prepare.Preparation``.
        knot: Verdict on the first chain; None without one.
        chains: Candidates, best first; at least one.
        likenesses: Likeness of each chain to the input; empty for paths and chains.
    """

    kind: str
    method: str
    notes: tuple[str, ...]
    knot: str | None
    chains: tuple[Chain, ...]
    likenesses: tuple[Likeness, ...]

    @classmethod
    def load(cls, directory: FilePath, key: str) -> Self | None:
        """Return the stored chains; None if there are none with this key."""
        try:
            values = from_plain(json.loads((directory / PREPARED).read_bytes()), dict[str, Any])
            if values["key"] != key:
                return None
            chains = from_plain(values["chains"], list[dict[str, Any]])
            return cls(
                kind=values["kind"],
                method=values["method"],
                notes=from_plain(values["notes"], tuple[str, ...]),
                knot=values["knot"],
                chains=tuple(chain_from_attributes(chain) for chain in chains),
                likenesses=from_plain(values["likenesses"], tuple[Likeness, ...]),
            )
        except UNREADABLE:
            return None

    def save(self, directory: FilePath, key: str) -> None:
        """Write the file that ``load`` reads."""
        values = {
            "key": key,
            "kind": self.kind,
            "method": self.method,
            "notes": self.notes,
            "knot": self.knot,
            "chains": [chain_attributes(chain) for chain in self.chains],
            "likenesses": [likeness.as_dict() for likeness in self.likenesses],
        }
        write_json(directory / PREPARED, values)


def key_of(data: bytes, filename: str | None, options: PathOptions, seed: int) -> str:
    """Return the digest of all that a path search depends on."""
    try:
        made_by = version("foldback")
    except PackageNotFoundError:
        made_by = ""
    key_values = [made_by, sha256(data).hexdigest(), filename, asdict(options), seed]
    return sha256(json.dumps(key_values, sort_keys=True).encode()).hexdigest()
