"""A bag's own description: its topics and files, metadata.yaml, and the writer's lock."""

from __future__ import annotations

import os
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

from pa_ros.bags.errors import BagError
from pa_ros.core.files import take_lock, write_whole
from pa_ros.core.yaml_text import read_yaml

BAG_VERSION: Final = 9  # of rosbag2's metadata, as ROS 2 Jazzy writes it
DISTRIBUTION: Final = "jazzy"
METADATA: Final = "metadata.yaml"
RESERVE: Final = ".reserve"  # a file that keeps space free for closing the bag on a full disk
UNLIMITED: Final = _QosTime(9223372036, 854775807)  # how rosbag2 writes an unlimited duration

# Keys of custom_data in metadata.yaml.
VERSION: Final = "pa_ros.version"  # of the recorder's software
LOST: Final = "pa_ros.lost"  # JSON: messages that were published but not received, by topic
BEFORE: Final = "pa_ros.before"  # JSON: messages published before the recorder connected, by topic
REPAIRED: Final = "pa_ros.repaired"  # what a repair found


@dataclass(frozen=True)
class BagTopic:
    """A topic as a bag declares it."""

    name: str
    type_name: str
    definition: str  # text of the message definition and of those it contains
    digest: str  # RIHS01 type hash
    qos: tuple[Qos, ...] = ()  # offered by its publishers

    @property
    def qos_text(self) -> str:
        """The quality of service in YAML, as storage files keep it."""
        profiles: Any = dump_qos_v9(list(self.qos))
        return yaml.safe_dump(profiles, sort_keys=False).strip() if profiles else ""


@dataclass
class FileContents:
    """Number and time of the messages in one storage file."""

    path: Path
    counts: dict[str, int] = field(default_factory=dict)  # messages by topic
    first_ns: int = 2**63 - 1  # wall time of the earliest message
    last_ns: int = 0  # wall time of the latest message

    def add(self, name: str, stamp_ns: int) -> None:
        """Count one message."""
        self.counts[name] = self.counts.get(name, 0) + 1
        self.first_ns = min(self.first_ns, stamp_ns)
        self.last_ns = max(self.last_ns, stamp_ns)

    @property
    def total(self) -> int:
        return sum(self.counts.values())


def topic(store: Typestore, name: str, type_name: str, qos: Iterable[Qos] = ()) -> BagTopic:
    """A topic whose type the store knows."""
    definition, _ = store.generate_msgdef(type_name, ros_version=2)
    return BagTopic(name, type_name, definition, store.hash_rihs01(type_name), tuple(qos))


def reliable_qos(depth: int, latched: bool = False, keep_all: bool = False) -> Qos:
    """A reliable profile in rosbag2's form."""
    return Qos(
        history=QosHistory.KEEP_ALL if keep_all else QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=UNLIMITED,
        lifespan=UNLIMITED,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=UNLIMITED,
        avoid_ros_namespace_conventions=False,
    )


def information(
    topics: Iterable[BagTopic],
    files: Iterable[FileContents],
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """`rosbag2_bagfile_information` as `ros2 bag info` of Jazzy reads it."""
    files = list(files)
    filled = [file for file in files if file.total]
    first = min((file.first_ns for file in filled), default=0)
    last = max((file.last_ns for file in filled), default=0)
    return {
        "version": BAG_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": last - first},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": sum(file.total for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": dump_qos_v9(list(topic.qos)),
                    "type_description_hash": topic.digest,
                },
                "message_count": sum(file.counts.get(topic.name, 0) for file in files),
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path.name for file in files],
        "files": [
            {
                "path": file.path.name,
                "starting_time": {"nanoseconds_since_epoch": file.first_ns if file.total else 0},
                "duration": {"nanoseconds": file.last_ns - file.first_ns if file.total else 0},
                "message_count": file.total,
            }
            for file in files
        ],
        "custom_data": dict(custom) or None,
        "ros_distro": DISTRIBUTION,
    }


def read_metadata(folder: Path) -> dict[str, Any]:
    """`rosbag2_bagfile_information` of a folder's metadata.yaml; empty without one.

    Raises ValueError if the file is not YAML, OSError if it cannot be read.
    """
    try:
        content = read_yaml((folder / METADATA).read_text())
    except (FileNotFoundError, NotADirectoryError):
        return {}
    about = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    return about if isinstance(about, dict) else {}


def custom_data(about: Mapping[str, Any]) -> dict[str, str]:
    """`custom_data` of a bag's metadata; empty if there is none."""
    custom = about.get("custom_data")
    return {str(k): str(v) for k, v in custom.items()} if isinstance(custom, dict) else {}


def write_metadata(folder: Path, content: dict[str, Any]) -> None:
    """Write metadata.yaml, completely or not at all."""
    text = yaml.safe_dump({"rosbag2_bagfile_information": content}, sort_keys=False)
    write_whole(folder / METADATA, text)


def repair_command(folder: Path) -> str:
    """The shell command that repairs a bag."""
    return f"`pa_ros record --repair {shlex.quote(str(folder))}`"


def damaged(path: Path, reason: object) -> BagError:
    """The error for a bag whose content is not what its format says."""
    return BagError(f"bag: {path}: {' '.join(str(reason).split())}", code="bag.damaged")


class FolderLock:
    """Marks a bag's folder as being written, until it is released or the process ends.

    The lock tells a running recording from a killed one. Other recorders than ours take no lock.
    """

    def __init__(self, folder: Path) -> None:
        """Raises BagError if another process has the lock, OSError if there is no folder."""
        self._descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        if not take_lock(self._descriptor):
            self.release()
            raise BagError(
                f"bag: {folder}: another process is still recording or repairing it: wait until it "
                "has ended",
                code="bag.in_use",
            )

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1

    def __enter__(self) -> FolderLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()
