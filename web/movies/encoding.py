"""Encoding: pictures to MP4 files with an installed ffmpeg, or to GIF files with Pillow."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from abc import ABC, abstractmethod
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, Self

import numpy as np
import zstandard
from numpy.typing import NDArray

from web.movies.movie import Movie

if TYPE_CHECKING:
    from PIL.Image import Image

X264_CRF: Final = 19
"""Constant rate factor of the video encoder x264, from 0 (lossless) to 51. A larger value makes
smaller files of lower quality; at this value no loss is visible. Chosen."""
X264_PRESET: Final = "veryfast"
"""Speed preset of the video encoder x264: twice as fast as the next slower one, and the files of
such plain pictures are no larger. Measured."""
FFMPEG_SETTING: Final = "IMAGEIO_FFMPEG_EXE"
"""Name of the environment variable with the path of an ffmpeg program that takes precedence over
the one on PATH."""
MAX_PALETTE_COLOURS: Final = 255
"""Number of colours of a GIF's palette. The format permits 256; Pillow needs one of them to mark
unchanged pixels."""
PALETTE_STRIDE: Final = 4
"""Step between sampled pixels, in rows, columns and frames, from which the palette of a GIF is
chosen. A larger value is faster and may miss colours of small areas. Chosen."""
DITHER_AMPLITUDE: Final = 8.0
"""Amplitude of the ordered dither that is added before the colours of a GIF are rounded to its
palette, in levels of 256. A larger value hides borders between colours better and makes the
dither's pattern more visible. Chosen."""
_BAYER: Final = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
"""Thresholds of the ordered dither for GIFs, in sixteenths: the 4×4 Bayer matrix."""


class EncodingError(Exception):
    """The encoder failed."""


class NoEncoderError(EncodingError):
    """There is no program that encodes this format."""


class Encoder(ABC):
    """Encoder of a movie's pictures, one by one; its file is complete once it is closed."""

    @abstractmethod
    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture.

        Args:
            picture: (H, W, 3) sRGB bytes, from the top.

        Raises:
            EncodingError: If the encoder has ended.
        """

    @abstractmethod
    def close(self, *, complete: bool) -> None:
        """Finish the file, which is unusable if ``complete`` is False."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(complete=kind is None)


def open_encoder(movie: Movie, out: Path) -> Encoder:
    """Return the encoder of a movie's format.

    Args:
        movie: Size, frame rate and format.
        out: The file to write.

    Raises:
        NoEncoderError: If the format is MP4 and there is no ffmpeg.
    """
    return GifEncoder(movie, out) if movie.format == "gif" else Mp4Encoder(movie, out)


def find_ffmpeg() -> str:
    """Return the path of ffmpeg: from the environment, on PATH, or from imageio-ffmpeg.

    Raises:
        NoEncoderError: If there is none.
    """
    if path := os.environ.get(FFMPEG_SETTING) or shutil.which("ffmpeg"):
        return path
    try:
        from imageio_ffmpeg import get_ffmpeg_exe  # the extra `movies`

        return get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        raise NoEncoderError("no ffmpeg is on PATH, and imageio-ffmpeg is not installed") from None


class Mp4Encoder(Encoder):
    """Encoder of MP4 files with ffmpeg."""

    def __init__(self, movie: Movie, out: Path) -> None:
        """Start ffmpeg.

        Raises:
            EncodingError: If it cannot be started.
        """
        command = [find_ffmpeg(), *_options(movie), str(out)]
        # ffmpeg logs to a file, because it would block on a full pipe that is not read.
        self._words: IO[bytes] = open(out.with_name(f"{out.name}.log"), "w+b")  # noqa: SIM115
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self._words
            )
        except OSError as error:
            self._close_words()
            raise EncodingError(f"{command[0]} cannot be started: {error.strerror}") from error

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(picture).data)
        except BrokenPipeError:
            raise EncodingError(self._said(self._process.wait())) from None

    def close(self, *, complete: bool) -> None:
        """Finish the file."""
        assert self._process.stdin is not None
        try:
            if not complete:
                self._process.kill()
            with contextlib.suppress(BrokenPipeError):  # its exit code is more informative
                self._process.stdin.close()
            code = self._process.wait()
            if complete and code:
                raise EncodingError(self._said(code))
        finally:
            self._close_words()

    def _close_words(self) -> None:
        self._words.close()
        Path(self._words.name).unlink(missing_ok=True)

    def _said(self, code: int) -> str:
        self._words.seek(0)
        words = self._words.read()[-400:].decode(errors="replace").strip()
        return f"the encoder ended with exit code {code}: {words or 'no message'}"


class GifEncoder(Encoder):
    """Encoder of GIF files with Pillow.

    All pictures share one palette, which depends on all of them, so they are held compressed until
    the end. Ordered dither compresses better than noise and does not flicker from frame to frame.
    """

    def __init__(self, movie: Movie, out: Path) -> None:
        self._movie = movie
        self._out = out
        self._packed: list[bytes] = []
        self._samples: list[NDArray[np.uint8]] = []
        rows, columns = -(-movie.height // 4), -(-movie.width // 4)
        pattern = np.tile((_BAYER + 0.5) / 16 - 0.5, (rows, columns)) * DITHER_AMPLITUDE
        self._pattern = pattern[: movie.height, : movie.width, None].round().astype(np.int16)

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture."""
        if len(self._packed) % PALETTE_STRIDE == 0:
            self._samples.append(picture[::PALETTE_STRIDE, ::PALETTE_STRIDE].copy())
        self._packed.append(zstandard.compress(np.ascontiguousarray(picture).data, 1))

    def close(self, *, complete: bool) -> None:
        """Finish the file."""
        if complete and self._packed:
            self._write()

    def _write(self) -> None:
        from PIL import Image  # MP4 does not need it

        samples = Image.fromarray(np.concatenate(self._samples))
        palette = samples.quantize(MAX_PALETTE_COLOURS, Image.Quantize.MEDIANCUT)
        pictures = (self._reduced(packed, palette) for packed in self._packed)
        # GIF times are hundredths of a second: each picture ends at the one nearest to its time.
        ends = [round(100 * k / self._movie.fps) for k in range(len(self._packed) + 1)]
        next(pictures).save(
            self._out,
            format="GIF",
            save_all=True,
            append_images=pictures,
            duration=[10 * (end - begin) for begin, end in zip(ends, ends[1:], strict=False)],
            loop=0,
            optimize=False,
        )

    def _reduced(self, packed: bytes, palette: Image) -> Image:
        """Return a picture in the colours of a palette."""
        from PIL import Image

        colours = np.frombuffer(zstandard.decompress(packed), np.uint8)
        dotted = colours.reshape(self._movie.height, self._movie.width, 3) + self._pattern
        picture = Image.fromarray(dotted.clip(0, 255).astype(np.uint8))
        return picture.quantize(palette=palette, dither=Image.Dither.NONE)


def _options(movie: Movie) -> list[str]:
    return [
        *("-hide_banner", "-loglevel", "error", "-nostats", "-y"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-video_size", f"{movie.width}x{movie.height}"),
        *("-framerate", str(movie.fps), "-i", "-", "-an"),
        *("-c:v", "libx264", "-preset", X264_PRESET, "-crf", str(X264_CRF)),
        # The pixel format that all players read, and the colour space that they assume.
        *("-vf", "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"),
        *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
        *("-movflags", "+faststart", "-f", "mp4"),
    ]
