"""Client of foldback's HTTP API: ``pip install 'foldback[client]'`` adds httpx, which it needs.

>>> with Client("http://127.0.0.1:8000") as client:             # doctest: +SKIP
...     fold = client.fold("part.stl", modules=240).wait()
...     fold.download("plan.npz", "plan.npz")
"""

from importlib.util import find_spec

if find_spec("httpx") is None:
    raise ImportError("foldback.client needs httpx: pip install 'foldback[client]'")

from foldback.client.client import Client
from foldback.client.fold import Fold
from foldback.client.frames import Frames
from foldback.client.problem import Problem
from foldback.client.progress import Progress
from foldback.client.retries import Retries

__all__ = ["Client", "Fold", "Frames", "Problem", "Progress", "Retries"]
