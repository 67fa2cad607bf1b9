"""Reading files that may be anything, each in its bounds."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pa_ros.bags.reader import Bag
from pa_ros.core.errors import PaError
from pa_ros.core.files import read_regular
from pa_ros.learning.checkpoint_files import LATEST, METADATA, SUMS
from pa_ros.learning.checkpoints import load_policy
from pa_ros.tools.launch_params import load_parameters
from pa_ros.wire.signing import read_key


def checkpoint_with(name: str) -> Callable[[Path], object]:
    """Load a checkpoint, one file of which is something else."""

    def load(path: Path) -> object:
        folder = path.parent / "checkpoint"
        folder.mkdir()
        (folder / METADATA).touch()
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(path)
        return load_policy(folder)

    return load


@pytest.mark.parametrize(
    "read",
    [read_key, load_parameters, Bag, *map(checkpoint_with, (METADATA, LATEST, SUMS))],
    ids=["key", "parameters", "bag", METADATA, LATEST, SUMS],
)
@pytest.mark.parametrize("endless", [False, True], ids=["pipe", "device"])
def test_what_may_have_no_end_is_rejected_at_once(
    tmp_path: Path, read: Callable[[Path], object], endless: bool
) -> None:
    path = tmp_path / "given"
    os.mkfifo(path, mode=0o600) if not endless else path.symlink_to("/dev/zero")
    with pytest.raises(PaError):
        read(path)


def test_a_file_is_read_up_to_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"four")
    assert read_regular(path, 4) == b"four"
    with pytest.raises(OSError, match="file: expected at most 3 bytes"):
        read_regular(path, 3)
    with pytest.raises(OSError, match="expected a regular file"):
        read_regular(Path("/dev/zero"), 3)
