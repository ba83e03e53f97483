"""Plan a fold: explode the folded chain, play the record back in reverse, verify the motion."""

from __future__ import annotations

from pathlib import Path as FilePath

from foldback.planner.certificate.certificate import certify
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.parameters.parameters import preset
from foldback.planner.playback.playback import play_back
from foldback.planner.readers import read

SHAPES = FilePath(__file__).parent / "shapes"


def main() -> None:
    path = read((SHAPES / "wrench-80.json").read_bytes())
    assert isinstance(path, Path)
    chain = Chain.from_path(path)
    parameters = preset("default")

    record = explode(chain, parameters.explosion, seed=0)
    print(f"explosion: {record.status}, {record.steps} steps, {record.seconds:.1f} s")

    playback = play_back(chain, record, parameters.playback, module_size=parameters.module_size)
    print(f"playback: {playback.status}, {playback.steps} steps, {playback.seconds:.1f} s")

    certificate = certify(chain, record, playback, parameters)
    print(f"certificate: {certificate.verdict}")
    print(f"  least clearance of the plan: {certificate.min_clearance:.4f} pitches")
    if certificate.simulated:
        print(f"  error where it ends, simulated: {certificate.rms_position_error:.1e} pitches")


if __name__ == "__main__":
    main()
