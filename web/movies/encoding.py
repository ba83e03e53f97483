"""Encoding: pictures into MP4 and GIF files, by the ffmpeg that imageio-ffmpeg brings along."""

from __future__ import annotations

import contextlib
import subprocess
from pathlib import Path
from types import TracebackType
from typing import IO, Final

import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe
from numpy.typing import NDArray

from web.movies.movie import Movie

QUALITY: Final = 19
"""Constant rate factor of x264, at which no coding can be seen."""
PRESET: Final = "veryfast"
"""Preset of x264: twice as quick as the next, files no larger with pictures as plain as these."""


class EncodingError(Exception):
    """The encoder did not do its work."""


class Encoder:
    """Takes the pictures of a movie one by one; its file is whole once it is closed in order."""

    def __init__(self, movie: Movie, out: Path) -> None:
        """Starts the encoder.

        Args:
            movie: Size, pace and format.
            out: The file to write; a GIF needs room for another one beside it for a while.
        """
        self._out = out
        self._raw = out if movie.format == "mp4" else out.with_name(f"{out.name}.mkv")
        # ffmpeg's words go to a file: a pipe that nobody reads would stop it one day.
        self._words: IO[bytes] = open(out.with_name(f"{out.name}.log"), "w+b")  # noqa: SIM115
        self._process = subprocess.Popen(
            [*_start(), *_pictures_in(movie), *_video(movie), str(self._raw)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._words,
        )

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Adds a picture.

        Args:
            picture: (H, W, 3) sRGB bytes, from the top.

        Raises:
            EncodingError: When the encoder has ended.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(picture).data)
        except BrokenPipeError:
            raise EncodingError(self._said(self._process.wait())) from None

    def __enter__(self) -> Encoder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._process.stdin is not None
        try:
            if error is not None:
                self._process.kill()
            with contextlib.suppress(BrokenPipeError):  # its exit code says more
                self._process.stdin.close()
            code = self._process.wait()
            if error is None:
                if code:
                    raise EncodingError(self._said(code))
                if self._raw != self._out:
                    self._make_gif()
        finally:
            self._words.close()
            for left in (Path(self._words.name), *([self._raw] * (self._raw != self._out))):
                left.unlink(missing_ok=True)

    def _make_gif(self) -> None:
        """In two goes, the first for the colours: in one, ffmpeg would hold all pictures at once.

        An even pattern of dots shrinks better than noise, and does not swarm from frame to frame.
        """
        palette = self._out.with_name(f"{self._out.name}.png")
        try:
            self._run("-i", str(self._raw), "-vf", "palettegen=stats_mode=full", str(palette))
            self._run(
                *("-i", str(self._raw), "-i", str(palette)),
                *("-lavfi", "paletteuse=dither=bayer:bayer_scale=4:diff_mode=rectangle"),
                *("-loop", "0", "-f", "gif", str(self._out)),
            )
        finally:
            palette.unlink(missing_ok=True)

    def _run(self, *arguments: str) -> None:
        found = subprocess.run(
            [*_start(), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._words,
            check=False,
        )
        if found.returncode:
            raise EncodingError(self._said(found.returncode))

    def _said(self, code: int) -> str:
        self._words.seek(0)
        words = self._words.read()[-400:].decode(errors="replace").strip()
        return f"the encoder ended with exit code {code}: {words or 'it said nothing'}"


def _start() -> list[str]:
    return [get_ffmpeg_exe(), "-hide_banner", "-loglevel", "error", "-nostats", "-y"]


def _pictures_in(movie: Movie) -> list[str]:
    size = f"{movie.width}x{movie.height}"
    shape = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-video_size", size]
    return [*shape, "-framerate", str(movie.fps), "-i", "-", "-an"]


def _video(movie: Movie) -> list[str]:
    if movie.format == "gif":  # on its way to one, without a loss
        return ["-c:v", "libx264rgb", "-preset", "ultrafast", "-qp", "0", "-f", "matroska"]
    return [
        *("-c:v", "libx264", "-preset", PRESET, "-crf", str(QUALITY)),
        # What all players read, in the colours that they take such a file to have.
        *("-vf", "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"),
        *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
        *("-movflags", "+faststart", "-f", "mp4"),
    ]
