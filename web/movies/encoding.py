"""Encoding: pictures to MP4 files with an installed ffmpeg, or to GIF files with Pillow."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import zstandard
from numpy.typing import NDArray

from foldback.web.movies.movie import FORMATS, Movie

AddPicture = Callable[[NDArray[np.uint8]], object]
"""Function that adds a picture to a movie: (H, W, 3) sRGB bytes, from the top."""
X264_PRESET: Final = "veryfast"
"""Speed preset of the video encoder x264: twice as fast as the next slower one, and the files of
such plain pictures are no larger. Measured."""
FFMPEG_SETTING: Final = "IMAGEIO_FFMPEG_EXE"
"""Name of the environment variable with the path of an ffmpeg program that takes precedence over
the one on PATH."""
PALETTE_STRIDE: Final = 4
"""Step between sampled pixels, in rows, columns and frames, from which the palette of a GIF is
chosen."""
_BAYER: Final = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
"""Thresholds of the ordered dither for GIFs, in sixteenths: the 4×4 Bayer matrix."""


class EncodingError(Exception):
    """The encoder failed."""


class NoEncoderError(EncodingError):
    """There is no program that encodes this format."""


def open_encoder(movie: Movie, out: Path) -> AbstractContextManager[AddPicture]:
    """Return the encoder of a movie's format; its file is complete when the context ends.

    After an error in the context, the file is missing or holds an incomplete movie.

    Args:
        movie: Size, frame rate and format.
        out: The file to write.

    Raises:
        NoEncoderError: If the format is MP4 and there is no ffmpeg. Raised by the context.
        EncodingError: If the encoder cannot be started or fails. Raised by the context.
    """
    return _gif_encoder(movie, out) if movie.format == "gif" else _mp4_encoder(movie, out)


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


def formats() -> tuple[str, ...]:
    """Return the movie formats that this machine can encode; GIF needs no program."""
    try:
        return FORMATS if _has_x264(find_ffmpeg()) else ("gif",)
    except NoEncoderError:
        return ("gif",)


@cache
def _has_x264(ffmpeg: str) -> bool:
    """Return True if an ffmpeg program starts and contains the encoder of MP4 movies."""
    try:
        answer = subprocess.run(
            [ffmpeg, "-hide_banner", "-encoders"],
            capture_output=True,
            timeout=20.0,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return b" libx264 " in answer.stdout


@contextmanager
def _mp4_encoder(movie: Movie, out: Path) -> Generator[AddPicture]:
    """Encode an MP4 file with ffmpeg."""
    command = [find_ffmpeg(), *_options(movie), str(out)]
    # ffmpeg logs to a file, because it would block on a full pipe that is not read.
    with tempfile.TemporaryFile(dir=out.parent) as log:
        try:
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log
            )
        except OSError as error:
            raise EncodingError(f"{command[0]} cannot be started: {error.strerror}") from error
        pipe = process.stdin
        assert pipe is not None
        ended_early = False
        try:
            yield lambda picture: pipe.write(np.ascontiguousarray(picture).data)
        except BrokenPipeError:
            ended_early = True
        finally:
            # ffmpeg ends with its input; the sandbox of the service permits no signals to it.
            with suppress(BrokenPipeError):  # the exit code is more informative
                pipe.close()
            code = process.wait()
        if code or ended_early:
            log.seek(0)
            words = log.read()[-400:].decode(errors="replace").strip() or "no message"
            raise EncodingError(f"the encoder ended with exit code {code}: {words}")


@contextmanager
def _gif_encoder(movie: Movie, out: Path) -> Generator[AddPicture]:
    """Encode a GIF file with Pillow.

    All pictures share one palette, which depends on all of them, so they are held compressed until
    the end. Ordered dither compresses better than noise and does not flicker from frame to frame.
    """
    from PIL import Image  # MP4 does not need it

    packed: list[bytes] = []
    samples: list[NDArray[np.uint8]] = []

    def add(picture: NDArray[np.uint8]) -> None:
        if len(packed) % PALETTE_STRIDE == 0:
            samples.append(picture[::PALETTE_STRIDE, ::PALETTE_STRIDE].copy())
        packed.append(zstandard.compress(np.ascontiguousarray(picture).data, 1))

    yield add  # pictures are encoded once all of them are known
    if not packed:
        return
    rows, columns = -(-movie.height // 4), -(-movie.width // 4)
    pattern = np.tile((_BAYER + 0.5) / 16 - 0.5, (rows, columns)) * 8.0
    dither = pattern[: movie.height, : movie.width, None].round().astype(np.int16)
    sampled = Image.fromarray(np.concatenate(samples))
    # the format has 256, and Pillow marks unchanged pixels by one
    palette = sampled.quantize(255, Image.Quantize.MEDIANCUT)

    def reduced(data: bytes) -> Image.Image:
        """Return a picture in the colours of the palette."""
        colours = np.frombuffer(zstandard.decompress(data), np.uint8)
        dotted = colours.reshape(movie.height, movie.width, 3) + dither
        picture = Image.fromarray(dotted.clip(0, 255).astype(np.uint8))
        return picture.quantize(palette=palette, dither=Image.Dither.NONE)

    pictures = map(reduced, packed)
    # GIF times are hundredths of a second: each picture ends at the one nearest to its time.
    ends = [round(100 * k / movie.fps) for k in range(len(packed) + 1)]
    next(pictures).save(
        out,
        format="GIF",
        save_all=True,
        append_images=pictures,
        duration=[10 * (end - start) for start, end in pairwise(ends)],
        loop=0,
        optimize=False,
    )


def _options(movie: Movie) -> list[str]:
    return [
        *("-hide_banner", "-loglevel", "error", "-nostats", "-y"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-video_size", f"{movie.width}x{movie.height}"),
        *("-framerate", str(movie.fps), "-i", "-", "-an"),
        *("-c:v", "libx264", "-preset", X264_PRESET, "-crf", "19"),
        # The pixel format that all players read, and the colour space that they assume.
        *("-vf", "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"),
        *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
        *("-movflags", "+faststart", "-f", "mp4"),
    ]
