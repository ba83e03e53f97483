"""Client of foldback's HTTP API that requires only httpx.

>>> with Client("http://127.0.0.1:8000") as client:             # doctest: +SKIP
...     fold = client.fold("part.stl", modules=240).wait()
...     fold.download("plan.npz", "plan.npz")
"""

from foldback.client.client import Client
from foldback.client.fold import Fold
from foldback.client.frames import Frames
from foldback.client.problem import Problem
from foldback.client.progress import Progress
from foldback.client.retries import Retries

__all__ = ["Client", "Fold", "Frames", "Problem", "Progress", "Retries"]
