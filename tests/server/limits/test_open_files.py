"""Open files: there are never more connections than file descriptors for them."""

import resource

import pytest

from foldback.server.limits.open_files import BACKLOG, MIN_CONNECTIONS, OTHER_FILES, OpenFiles
from foldback.server.settings import Settings


@pytest.mark.parametrize("hard", [0, 64, 256, 1024, 4096, 2**20, resource.RLIM_INFINITY])
@pytest.mark.parametrize("wanted", [1, 100, 2000, 10**6])
def test_connections_leave_file_descriptors_for_everything_else(hard: int, wanted: int) -> None:
    found = OpenFiles.of(Settings(max_connections=wanted), hard)
    unlimited = hard == resource.RLIM_INFINITY
    assert found.connections <= wanted
    assert found.connections == wanted or found.files == hard
    if unlimited or hard >= wanted + OTHER_FILES + BACKLOG:
        assert (found.connections, found.backlog) == (wanted, BACKLOG)
    else:
        needed = found.connections + found.backlog + OTHER_FILES
        assert needed <= hard or found.connections <= MIN_CONNECTIONS
