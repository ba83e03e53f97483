"""Zarr groups whose chunks and attributes are checked when they are read.

zarr reads a missing chunk as fill values and does not notice a changed byte. Arrays that are
created here carry a CRC-32C in each chunk (zarr's own ``crc32c`` codec, which other readers know),
and chunks that hold only fill values are written as well, so that a missing one is an error. A
group that is complete lists the checksum of each chunk file among its attributes, which shows a
valid chunk in the wrong place. The attributes themselves carry a SHA-256.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Final, cast

from foldback.planner.errors import DamagedError
from foldback.planner.storage.files import load_zarr

if TYPE_CHECKING:
    import zarr

ROOT_FILE: Final = "zarr.json"
DIGEST: Final = "sha256"
"""Name of the attribute of a zarr group that holds the SHA-256 digest of all its other attributes,
so that damaged ones are noticed."""
CHECKSUMS: Final = "chunks"
"""Name of the attribute of a zarr group that holds the checksums of each array's chunk files, so
that damaged ones are noticed; only completely written groups have it."""
Checksums = dict[str, list[int | None]]
"""By name of an array: CRC-32 of each chunk file, None for a chunk that was never written."""


def create_group(path: str | FilePath) -> zarr.Group:
    """Create an empty group, which replaces what was at the path."""
    store = _single_writer_store(FilePath(path))
    return load_zarr().open_group(store=store, mode="w", zarr_format=3)


def create_array(
    group: zarr.Group,
    name: str,
    *,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dtype: Any,
    fill_value: float = 0,
) -> zarr.Array[Any]:
    """Create a compressed array with a checksum in each chunk."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    return group.create_array(
        name,
        shape=shape,
        chunks=chunks,
        dtype=dtype,
        compressors=[BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
        fill_value=fill_value,
        config={"write_empty_chunks": True},
    )


def open_for_writing(path: str | FilePath) -> tuple[zarr.Group, dict[str, zarr.Array[Any]]]:
    """Return a group and its arrays, which write also chunks that hold only fill values."""
    zarr = load_zarr()
    with zarr.config.set({"array.write_empty_chunks": True}):
        group = zarr.open_group(str(path), mode="r+")
        return group, {name: array for name, array in group.arrays()}


def read_group(path: str | FilePath) -> zarr.Group:
    """Open a group for reading.

    Raises:
        FileNotFoundError: If there is none.
        DamagedError: If its attributes are not what was written. Reading an array of it raises
            DamagedError for a chunk that is missing or is not what was written.
    """
    root = FilePath(path) / ROOT_FILE
    if not root.exists():
        raise FileNotFoundError(f"no {ROOT_FILE} in {path}")
    zarr = load_zarr()
    store = _checked_store(FilePath(path))
    try:
        group = zarr.open_group(store=store, mode="r")
        attributes = group.attrs.asdict()
        # A group that is just being created has no attributes yet.
        if attributes and DIGEST not in attributes:
            raise DamagedError(root, "the digest of the file's attributes is missing")
        if attributes and attributes[DIGEST] != _digest(attributes):
            raise DamagedError(root, "the file's attributes do not match their digest")
        store.checksums = attributes.get(CHECKSUMS, {})
    except (DamagedError, FileNotFoundError):
        raise
    except Exception as error:  # zarr, its codecs and JSON each have errors of their own
        raise DamagedError(root, f"{type(error).__name__}: {error}") from error
    return group


def array_of(group: zarr.Group, path: str | FilePath, name: str) -> zarr.Array[Any]:
    """Return an array of a group that was opened at ``path``.

    Raises:
        DamagedError: If there is none, or its description is not one of an array.
    """
    try:
        return cast("zarr.Array[Any]", group[name])
    except DamagedError:
        raise
    except Exception as error:  # zarr raises a TypeError, too, for a value of the wrong type
        raise DamagedError(FilePath(path) / name, f"{type(error).__name__}: {error}") from error


def sealed(attributes: Mapping[str, Any], checksums: Checksums | None = None) -> dict[str, Any]:
    """Return attributes with their digest, and with checksums of chunk files if given."""
    values = unsealed(attributes)
    if checksums is not None:
        values[CHECKSUMS] = checksums
    return {**values, DIGEST: _digest(values)}


def unsealed(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes without their digest and checksums, which depend on the compressor."""
    return {k: v for k, v in attributes.items() if k not in (DIGEST, CHECKSUMS)}


def checksums_of(path: str | FilePath, arrays: Mapping[str, zarr.Array[Any]]) -> Checksums:
    """Return the checksum of each chunk file of arrays that are complete."""

    def checksum(file: FilePath) -> int | None:
        try:
            return zlib.crc32(file.read_bytes())
        except FileNotFoundError:
            return None

    return {
        name: [checksum(file) for file in _chunk_files(FilePath(path) / name, array)]
        for name, array in sorted(arrays.items())
    }


def check_chunks(path: str | FilePath) -> None:
    """Compare all chunk files of a complete group with its checksums, without unpacking them.

    Raises:
        FileNotFoundError: If there is no group.
        DamagedError: If one is missing or is not what was written.
    """
    group = read_group(path)
    checksums = cast("Checksums", group.attrs.asdict().get(CHECKSUMS, {}))
    for name in checksums:
        array = array_of(group, path, name)
        for number, file in enumerate(_chunk_files(FilePath(path) / name, array)):
            if _expected(checksums, name, number) is None:
                continue
            try:
                data = file.read_bytes()
            except OSError as error:
                raise DamagedError(file, _reason(error)) from error
            _compare(file, data, _expected(checksums, name, number))


def _chunk_files(directory: FilePath, array: zarr.Array[Any]) -> Iterator[FilePath]:
    """Yield the files of the chunks along the first axis; each holds whole rows."""
    if 0 in array.shape:
        return
    tail = ["0"] * (array.ndim - 1)
    for number in range(-(-array.shape[0] // array.chunks[0])):
        yield directory.joinpath("c", str(number), *tail)


def _expected(checksums: Checksums, name: str, number: int) -> int | None:
    digests = checksums.get(name, [])
    return digests[number] if number < len(digests) else None


def _compare(file: FilePath, data: Any, expected: int | None) -> None:
    if expected is not None and zlib.crc32(data) != expected:
        raise DamagedError(file, "the file's bytes do not match their checksum")


def _reason(error: OSError) -> str:
    return "the file is missing" if isinstance(error, FileNotFoundError) else str(error.strerror)


def _digest(attributes: Mapping[str, Any]) -> str:
    values = {k: v for k, v in attributes.items() if k != DIGEST}
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def _single_writer_store(path: FilePath) -> Any:
    """Return a zarr store for writing that makes no hard links.

    zarr links a temporary file to create one that no other process creates at the same time. The
    sandbox of the service refuses links, and one process alone writes a group.
    """
    from zarr.storage import LocalStore

    class SingleWriterStore(LocalStore):
        async def set_if_not_exists(self, key: str, value: Any) -> None:
            if not await self.exists(key):
                await self.set(key, value)

    return SingleWriterStore(path)


def _checked_store(path: FilePath) -> Any:
    """Return a zarr store for reading that looks at each chunk before it is unpacked."""
    from zarr.storage import LocalStore

    class CheckedStore(LocalStore):
        checksums: Checksums = {}

        async def get(self, key: str, *args: Any, **kwargs: Any) -> Any:
            return self._checked(key, await super().get(key, *args, **kwargs))

        def get_sync(self, key: str, **kwargs: Any) -> Any:
            return self._checked(key, super().get_sync(key, **kwargs))

        def _checked(self, key: str, content: Any) -> Any:
            parts: Sequence[str] = key.split("/")
            if len(parts) < 3 or parts[1] != "c":
                return content
            file = path / key
            if content is None:
                raise DamagedError(file, "the file is missing")
            expected = _expected(self.checksums, parts[0], int(parts[2]))
            _compare(file, content.as_buffer_like(), expected)
            return content

    return CheckedStore(path, read_only=True)
