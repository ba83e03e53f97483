"""Machine fingerprint: the hardware and libraries that floating-point results depend on."""

import platform
from hashlib import sha256
from importlib.metadata import version
from typing import Final

from bench.machine import processor

PACKAGES: Final = ("highspy", "mujoco", "numpy", "scipy")
"""Packages whose versions may change the last digits of a result."""
KEY_LENGTH: Final = 12
"""Number of hexadecimal digits of a machine's key; 12 distinguish some millions of machines."""


ARITHMETIC: Final = ("amx", "asimd", "avx", "bmi", "f16c", "fma", "fp", "sse", "ssse", "sve")
"""Prefixes of instruction sets that libraries compute with. Others, such as those of the kernel's
mitigations, may change while the results stay the same."""


def machine() -> dict[str, str]:
    """Return the properties of this machine that results depend on."""
    return {
        "processor": processor(),
        "flags": _digest(_processor_flags()),
        "libc": " ".join(platform.libc_ver()),
        **{name: version(name) for name in PACKAGES},
    }


def machine_key(values: dict[str, str]) -> str:
    """Return the key under which digests of a machine are stored."""
    return _digest("\n".join(f"{name}={values[name]}" for name in sorted(values)))


def _processor_flags() -> str:
    """Return the processor's instruction sets for arithmetic."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            flags = next(line for line in lines if line.startswith(("flags", "Features")))
            names = flags.partition(":")[2].split()
            return " ".join(sorted(name for name in names if name.startswith(ARITHMETIC)))
    except (OSError, StopIteration):
        return platform.machine()


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:KEY_LENGTH]
