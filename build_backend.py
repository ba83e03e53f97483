"""Build backend: scikit-build-core, with a compiler from the package index where there is none.

PEP 517. ``ziglang`` brings Clang as a wheel; pip installs it into the build environment, which it
removes afterwards.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryDirectory

from scikit_build_core import build as backend
from scikit_build_core.build import get_requires_for_build_sdist, prepare_metadata_for_build_wheel

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

COMPILER_PACKAGE = "ziglang==0.15.2"
"""A C++20 compiler as a wheel."""
Settings = dict[str, list[str] | str] | None

build_sdist = backend.build_sdist
prepare_metadata_for_build_editable = backend.prepare_metadata_for_build_editable


def has_compiler() -> bool:
    """Return True if CMake will find a C++ compiler: that of CXX, or one of the usual names."""
    names = ("c++", "g++", "clang++", "cl", "clang-cl")
    return "CXX" in os.environ or any(shutil.which(name) for name in names)


@contextmanager
def with_compiler(settings: Settings) -> Iterator[Settings]:
    """Yield settings for the build; if the machine has no compiler, name that of the package.

    That one is gone after the build, and so are files that name it and its cache.
    """
    if has_compiler():
        yield settings
        return
    with TemporaryDirectory() as place:
        os.environ["CXX"] = f"{sys.executable} -m ziglang c++"
        os.environ["ZIG_GLOBAL_CACHE_DIR"] = os.environ["ZIG_LOCAL_CACHE_DIR"] = place
        try:
            yield {**(settings or {}), "build-dir": f"{place}/build"}
        finally:
            for name in ("CXX", "ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
                del os.environ[name]


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what building needs besides ``build-system.requires``."""
    requires = backend.get_requires_for_build_wheel(config_settings)
    return requires if has_compiler() else [*requires, COMPILER_PACKAGE]


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """Return what building for an editable installation needs besides."""
    requires = backend.get_requires_for_build_editable(config_settings)
    return requires if has_compiler() else [*requires, COMPILER_PACKAGE]


def build_wheel(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Build a wheel, and return its file name."""
    with with_compiler(config_settings) as settings:
        return backend.build_wheel(wheel_directory, settings, metadata_directory)


def build_editable(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Build a wheel for an editable installation, and return its file name."""
    with with_compiler(config_settings) as settings:
        return backend.build_editable(wheel_directory, settings, metadata_directory)
