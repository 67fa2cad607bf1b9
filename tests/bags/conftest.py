"""A bag for all tests of a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from program_bags import storage_file, written


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Path, bytes]:
    folder = tmp_path_factory.mktemp("whole") / "bag"
    written(folder, 12, 200)
    return folder, storage_file(folder).read_bytes()
