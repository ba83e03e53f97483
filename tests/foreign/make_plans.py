"""Fold five plans, export each, and write the poses that other programs must agree with."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from foldback.planner.exports.formats import EXPORTS
from foldback.planner.exports.urdf import centre_of
from foldback.planner.plan.plan import Plan

FRAMES = 7
FOLDS = {
    "short": ("fold", str(Path(__file__).with_name("short.json"))),
    "wrench-24": ("fold", "wrench-24"),
    "ring": ("fold", "--angles", "- - - + - - - + - - -"),
    "mallet-64": ("fold", "mallet-64"),
    "refold": ("refold", "wrench-24", "mallet-24"),
}


def main(out: Path) -> None:
    for name, command in FOLDS.items():
        directory = out / name
        if (directory / "poses.npz").exists():
            continue
        program = [sys.executable, "-m", "foldback.server.cli.command_line", *command]
        subprocess.run([*program, "--out", str(directory)], check=True)
        plan = Plan.load(directory / "plan.npz")
        for export in (export for export in EXPORTS if not export.coded):
            (directory / export.filename).write_bytes(export.write(plan))
        chain = plan.chain
        frames = np.linspace(0, len(plan.time_s) - 1, FRAMES).round().astype(int)
        poses = chain.poses(
            plan.joint_angles_rad[frames], plan.root_position[frames], plan.root_wxyz[frames]
        )
        np.savez(
            directory / "poses.npz",
            time_s=plan.time_s[frames],
            angles_rad=plan.joint_angles_rad[frames],
            joint_names=np.array(chain.joint_names),
            positions_m=poses.positions * chain.pitch_m,
            rotations=poses.rotations,
            centres_m=np.array([centre_of(chain, i) for i in range(len(chain))]),
            root=chain.root,
            pitch_m=chain.pitch_m,
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
