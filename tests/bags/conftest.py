"""Bags for all tests of a file, or of several that are of one xdist_group."""

from pathlib import Path

import pytest

from helpers.recordings import acted, rearranged, recorded, storage_file, train, written


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Path, bytes]:
    folder = tmp_path_factory.mktemp("whole") / "bag"
    written(folder, 12, 200)
    return folder, storage_file(folder).read_bytes()


@pytest.fixture(scope="session")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of transitions: three episodes of a run in one process."""
    folder = tmp_path_factory.mktemp("learned")
    assert train(folder, "--record", folder / "bag", frames=300) == 0
    return folder / "bag"


@pytest.fixture(scope="session")
def stepped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the arena's topics, parts of a step in changing order, one step sent twice."""
    return recorded(tmp_path_factory.mktemp("stepped") / "bag", acted())


@pytest.fixture(scope="session")
def changing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the episode in which there are fewer blocks, then more."""
    return recorded(tmp_path_factory.mktemp("changing") / "bag", rearranged())
