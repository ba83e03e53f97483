"""Open files: there are never more connections than file descriptors for them."""

import resource

import pytest

from foldback.server.limits.open_files import BACKLOG, MIN_CONNECTIONS, OTHER_FILES, OpenFiles
from foldback.server.settings import Settings


@pytest.mark.parametrize("hard", [0, 64, 256, 1024, 4096, 2**20, resource.RLIM_INFINITY])
@pytest.mark.parametrize("expected", [1, 100, 2000, 10**6])
def test_connections_leave_file_descriptors_for_everything_else(hard: int, expected: int) -> None:
    open_files = OpenFiles.of(Settings(max_connections=expected), hard)
    unlimited = hard == resource.RLIM_INFINITY
    assert open_files.connections <= expected
    assert open_files.connections == expected or open_files.files == hard
    if unlimited or hard >= expected + OTHER_FILES + BACKLOG:
        assert (open_files.connections, open_files.backlog) == (expected, BACKLOG)
    else:
        needed = open_files.connections + open_files.backlog + OTHER_FILES
        assert needed <= hard or open_files.connections <= MIN_CONNECTIONS
