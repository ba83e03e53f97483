"""Fold a shape on a running service, follow its progress, and download plan and last frame."""

from __future__ import annotations

import argparse
from pathlib import Path

from foldback.client import Client, Progress


def show(progress: Progress) -> None:
    stage = f"{progress.stage or progress.status}, {progress.fraction:.0%}"
    print(f"{stage}, {progress.frames} frames", flush=True)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--url", default="http://127.0.0.1:8000")
    options.add_argument("--shape", default="box-4x4x4", help="of the service's gallery")
    options.add_argument("--file", type=Path, help="or a file: a mesh, voxels, a path or a chain")
    options.add_argument("--modules", type=int, help="about how many, for a mesh or voxels")
    options.add_argument("--out", type=Path, default=Path("."), help="a directory that is there")
    arguments = options.parse_args()
    with Client(arguments.url) as client:
        size = {} if arguments.modules is None else {"modules": arguments.modules}
        if arguments.file is not None:
            fold = client.fold(arguments.file, **size)
        else:
            fold = client.fold(shape=arguments.shape, **size)
        print(f"{fold.page}, owner token {fold.token}")
        fold.wait(on_progress=show)
        if not fold.verified:
            raise SystemExit(f"{fold.status}: {fold.state['error']}")
        print(f"clearance {fold.summary['certificate']['min_clearance']:.3f} pitches")
        for name in ("plan.npz", "urdf"):
            print(f"written: {fold.download(name, arguments.out)}")
        page = next(fold.frames(start=fold.state["progress"]["frames"] - 1))
        print(f"{len(page.joint_names)} joints, folded: {page.joint_angles_rad[-1]}")


if __name__ == "__main__":
    main()
