"""A bag's index and its files: every message is read, or it is said that they differ."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer

from helpers.damage import WRONG_YAML
from helpers.recordings import START, TOPIC, identifiers, payload, storage_file, written
from pa_ros.bags.errors import DamagedBagError, ForeignBagError
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair


def edited(folder: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    """A bag whose metadata.yaml went through `change`."""
    about = folder / "metadata.yaml"
    content = yaml.safe_load(about.read_text())
    change(content["rosbag2_bagfile_information"])
    about.write_text(yaml.safe_dump(content))
    return folder


def first_topic(about: dict[str, Any]) -> dict[str, Any]:
    topic: dict[str, Any] = about["topics_with_message_count"][0]
    return topic


def another_depth(about: dict[str, Any]) -> None:
    first_topic(about)["topic_metadata"]["offered_qos_profiles"][0]["depth"] = 7


def another_hash(about: dict[str, Any]) -> None:
    first_topic(about)["topic_metadata"]["type_description_hash"] = "RIHS01_0"


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("change", [another_depth, another_hash])
def test_other_words_of_a_topic_in_the_index_hide_no_message(tmp_path, storage, change):
    written(tmp_path / "bag", 3, storage=storage)
    edited(tmp_path / "bag", change)
    assert identifiers(tmp_path / "bag") == [0, 1, 2]
    with Bag(tmp_path / "bag") as bag:
        assert [profile.depth for profile in bag.qos("/program")] == [1]


def no_topic(about: dict[str, Any]) -> None:
    about["topics_with_message_count"] = []


def fewer(about: dict[str, Any]) -> None:
    first_topic(about)["message_count"] = 2


def another_total(about: dict[str, Any]) -> None:
    about["message_count"] = 2


def another_type(about: dict[str, Any]) -> None:
    first_topic(about)["topic_metadata"]["type"] = "std_msgs/msg/String"


def another_name(about: dict[str, Any]) -> None:
    first_topic(about)["topic_metadata"]["name"] = "/programs"


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("change", [no_topic, fewer, another_total, another_type, another_name])
def test_an_index_that_says_otherwise_than_its_files_is_refused_until_repaired(
    tmp_path, storage, change
):
    written(tmp_path / "bag", 3, storage=storage)
    edited(tmp_path / "bag", change)
    with pytest.raises(DamagedBagError, match=r"its index says .*; its files hold .*--repair"):
        Bag(tmp_path / "bag")
    assert repair(tmp_path / "bag").messages == 3
    assert identifiers(tmp_path / "bag") == [0, 1, 2]


def test_a_file_that_was_exchanged_is_noticed(tmp_path):
    written(tmp_path / "bag", 4, split_s=2.0)
    file = next((tmp_path / "bag").glob("*_1.mcap"))
    written(tmp_path / "other", 1)
    storage_file(tmp_path / "other").rename(file)
    with pytest.raises(DamagedBagError, match="its index says 4 of /program .* hold 3 of /program"):
        Bag(tmp_path / "bag")


def merged(path: Path, schemas: list[tuple[str, bytes]]) -> Path:
    """An .mcap file with a channel of /program for each schema, and three messages in each."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        for number, (name, text) in enumerate(schemas):
            schema = writer.register_schema(name, "ros2msg", text)
            channel = writer.register_channel("/program", "cdr", schema, {"of": str(number)})
            for i in range(3):
                writer.add_message(channel, START + i, payload(3 * number + i), START + i, i)
        writer.finish()
    return path


OURS = (TOPIC.type_name, TOPIC.definition.encode())


@pytest.mark.parametrize("second", [OURS, (OURS[0], b"# said otherwise\n" + OURS[1])])
def test_a_topic_of_several_channels_is_read_whole(tmp_path, second):
    file = merged(tmp_path / "merged.mcap", [OURS, second])
    with file.open("rb") as stream:
        counted = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
    with Bag(file) as bag:
        assert bag.counts == counted == {"/program": 6}
    assert sorted(identifiers(file)) == list(range(6))
    (tmp_path / "bag").mkdir()
    file.rename(tmp_path / "bag" / "bag.mcap")
    assert repair(tmp_path / "bag").messages == 6
    assert sorted(identifiers(tmp_path / "bag")) == list(range(6))


@pytest.mark.parametrize("second", [("std_msgs/msg/String", b"string data"),
                                    (OURS[0], b"string another")])  # fmt: skip
def test_a_topic_of_two_types_is_refused(tmp_path, second):
    file = merged(tmp_path / "merged.mcap", [OURS, second])
    with pytest.raises(ForeignBagError, match="/program: expected messages of one type, got"):
        Bag(file)


@pytest.mark.parametrize("text", WRONG_YAML.values(), ids=WRONG_YAML.keys())
@pytest.mark.parametrize("where", ["custom_data", "relative_file_paths"])
def test_an_index_of_wrong_yaml_is_refused_until_repaired(whole, tmp_path, text, where):
    shutil.copytree(whole[0], tmp_path / "bag")
    about = edited(tmp_path / "bag", lambda content: content.pop(where)) / "metadata.yaml"
    inside = "\n".join(f"    {line}" for line in text.splitlines())
    about.write_text(f"{about.read_text()}  {where}:\n{inside}\n")
    with pytest.raises(DamagedBagError, match="--repair"):
        Bag(tmp_path / "bag")
    assert repair(tmp_path / "bag").messages == 12
    assert identifiers(tmp_path / "bag") == list(range(12))
