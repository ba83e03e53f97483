"""Moves the time of day of a process by what a file says, from one moment to the next.

Clocks that measure durations are left alone, as they are when somebody sets a machine's clock.
"""

import mmap
import os
import struct
import time

if named := os.environ.get("FOLDBACK_LOAD_CLOCK"):
    with open(named, "rb") as file:
        ahead = mmap.mmap(file.fileno(), 8, prot=mmap.PROT_READ)
    real_ns = time.time_ns

    def time_ns() -> int:
        return real_ns() + struct.unpack_from("<q", ahead)[0]

    time.time_ns = time_ns
    time.time = lambda: time_ns() / 1e9
