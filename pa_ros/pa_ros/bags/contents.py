"""What a bag's files and metadata.yaml say of their topics, the same for either storage."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability
from rosbags.interfaces import QosTime as _QosTime
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys.store import Typestore

from pa_ros.bags.errors import DamagedBagError
from pa_ros.core.yaml_text import read_yaml

BAG_VERSION: Final = 9  # of rosbag2's metadata, as Jazzy writes it
DISTRIBUTION: Final = "jazzy"
METADATA: Final = "metadata.yaml"
RESERVE: Final = ".reserve"  # a file that keeps room for index and metadata on a full disk
FOREVER: Final = _QosTime(9223372036, 854775807)  # how rosbag2 writes an unlimited duration


@dataclass(frozen=True)
class BagTopic:
    """A topic as a bag declares it."""

    name: str
    type_name: str
    definition: str  # text of the message definition, with those that it needs
    digest: str  # RIHS01 type hash
    qos: tuple[Qos, ...] = ()  # offered by its publishers

    @property
    def qos_text(self) -> str:
        """The profiles in YAML, as storages keep them."""
        profiles: Any = dump_qos_v9(list(self.qos))
        return yaml.safe_dump(profiles, sort_keys=False).strip() if profiles else ""


@dataclass
class FileContents:
    """What one storage file holds."""

    path: Path
    counts: dict[str, int] = field(default_factory=dict)  # messages by topic
    first_ns: int = 2**63 - 1  # of the earliest and the latest message, wall time
    last_ns: int = 0

    def add(self, name: str, stamp_ns: int) -> None:
        """Count one message."""
        self.counts[name] = self.counts.get(name, 0) + 1
        self.first_ns = min(self.first_ns, stamp_ns)
        self.last_ns = max(self.last_ns, stamp_ns)

    @property
    def total(self) -> int:
        return sum(self.counts.values())


def topic(
    store: Typestore, name: str, type_name: str, qos: Iterable[Qos] = (), digest: str = ""
) -> BagTopic:
    """A topic whose type the store knows."""
    definition, _ = store.generate_msgdef(type_name, ros_version=2)
    digest = digest or store.hash_rihs01(type_name)
    return BagTopic(name, type_name, definition, digest, tuple(qos))


def reliable_qos(depth: int, latched: bool = False, keep_all: bool = False) -> Qos:
    """A reliable profile as rosbag2's metadata states it."""
    return Qos(
        history=QosHistory.KEEP_ALL if keep_all else QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=FOREVER,
        lifespan=FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=FOREVER,
        avoid_ros_namespace_conventions=False,
    )


def information(
    storage: str,
    topics: Iterable[BagTopic],
    files: Iterable[FileContents],
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """`rosbag2_bagfile_information`, complete, as `ros2 bag info` of Jazzy reads it."""
    files = list(files)
    filled = [file for file in files if file.total]
    first = min((file.first_ns for file in filled), default=0)
    last = max((file.last_ns for file in filled), default=0)
    return {
        "version": BAG_VERSION,
        "storage_identifier": storage,
        "duration": {"nanoseconds": last - first},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": sum(file.total for file in files),
        "topics_with_message_count": [_topic_entry(topic, files) for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path.name for file in files],
        "files": [_file_entry(file) for file in files],
        "custom_data": dict(custom) or None,
        "ros_distro": DISTRIBUTION,
    }


def stated(folder: Path) -> dict[str, Any]:
    """What a folder's metadata.yaml says, of whatever kinds; empty if there is none, or it is of
    something else. Raises DamagedBagError if it is no YAML."""
    try:
        content = read_yaml((folder / METADATA).read_text())
    except OSError:
        return {}
    except ValueError as error:
        raise DamagedBagError(
            f"bag: {folder}: {METADATA}: {error}; try {repair_command(folder)}"
        ) from error
    about = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    return about if isinstance(about, dict) else {}


def repair_command(folder: Path) -> str:
    """What to give a shell to have a bag made whole."""
    return f"`pa_ros record --repair {shlex.quote(str(folder))}`"


def write_metadata(folder: Path, content: dict[str, Any]) -> None:
    """Write metadata.yaml, whole or not at all."""
    unfinished = folder / f".{METADATA}"
    text = yaml.safe_dump({"rosbag2_bagfile_information": content}, sort_keys=False)
    unfinished.write_text(text)
    unfinished.replace(folder / METADATA)


def _topic_entry(topic: BagTopic, files: list[FileContents]) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": dump_qos_v9(list(topic.qos)),
            "type_description_hash": topic.digest,
        },
        "message_count": sum(file.counts.get(topic.name, 0) for file in files),
    }


def _file_entry(file: FileContents) -> dict[str, Any]:
    first, last = (file.first_ns, file.last_ns) if file.total else (0, 0)
    return {
        "path": file.path.name,
        "starting_time": {"nanoseconds_since_epoch": first},
        "duration": {"nanoseconds": last - first},
        "message_count": file.total,
    }
