"""A bag that is damaged anywhere is read, repaired or refused by type, and nothing hangs."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from hypothesis import strategies as st

from helpers.damage import explore
from helpers.recordings import train
from pa_ros.bags.errors import BagError
from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.core.errors import PaError

BAGS = 5_000
Damage = tuple[int, bytes | None]  # where (share of the file), what is written; None: it ends there


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run's bag."""
    folder = tmp_path_factory.mktemp("recorded")
    assert train(folder / "run", "--record", folder / "bag", frames=100) == 0
    return folder / "bag"


damages: st.SearchStrategy[list[tuple[str, int, bytes | None]]] = st.lists(
    st.tuples(
        st.sampled_from([".mcap", ".mcap", ".mcap", ".yaml"]),
        st.integers(0, 10**6),
        st.one_of(st.none(), st.binary(min_size=1, max_size=16)),
    ),
    min_size=1,
    max_size=3,
)


def damage(bag: Path, suffix: str, where: int, written: bytes | None) -> None:
    (path,) = [one for one in bag.iterdir() if one.suffix == suffix]
    content = path.read_bytes()
    at = where * len(content) // 10**6
    rest = b"" if written is None else written + content[at + len(written) :]
    path.write_bytes(content[:at] + rest)


def read(bag: Path) -> None:
    """Everything that is in it, or a refusal by type."""
    try:
        with Bag(bag) as opened:
            for recorded in opened.messages():
                try:
                    opened.deserialize(recorded)
                except BagError:
                    continue
        with Bag(bag) as opened:
            Experience(opened)
    except PaError as error:
        assert str(error)


@pytest.mark.timeout(0)
def test_bags(recorded: Path, tmp_path: Path):
    copy = tmp_path / "bag"

    def check(case: list[tuple[str, int, bytes | None]]) -> None:
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(recorded, copy)
        for one in case:
            damage(copy, *one)
        read(copy)
        try:
            repair(copy)
        except PaError:
            return
        read(copy)

    explore(damages, check, BAGS)
