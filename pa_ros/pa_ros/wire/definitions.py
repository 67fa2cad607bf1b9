"""Installed message definitions, and messages as recorded bytes, without ROS."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pa_ros.wire import WireError

# NumPy types of ROS types that NumPy does not know by name.
_DTYPES = {"octet": "uint8", "byte": "uint8", "char": "uint8"}
_FEEDBACK = "_FeedbackMessage"  # ends the type of an action's topic `_action/feedback`


def installed_types() -> Typestore:
    """A new store with the types of ROS 2 Jazzy and of msgs_schema."""
    store = get_typestore(Stores.ROS2_JAZZY)
    register(store, "msgs_schema/msg/Trajectory")
    return store


def register(store: Typestore, type_name: str) -> None:
    """Add a type from the .msg files that its package installs. Raises WireError."""
    if type_name in store.fielddefs:
        return
    package = type_name.partition("/")[0]
    for name, text in _definitions(package):
        if name not in store.fielddefs:
            store.register(get_types_from_msg(text, name))
    if type_name not in store.fielddefs:
        expected = "a type of a package that is installed here"
        raise WireError(type_name, expected, "none", code="wire.unknown_type")


@lru_cache(maxsize=128)
def hash_of(type_name: str, definition: str) -> str:
    """The type hash of a definition's text; empty if it cannot be parsed."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, type_name))
        return str(store.hash_rihs01(type_name))
    except Exception:  # rosbags raises many kinds for a wrong text
        return ""


def message_class(type_name: str) -> Any:
    """The installed class of a type. Raises WireError."""
    package, kind, name = type_name.split("/")
    try:
        module, action = import_module(f"{package}.{kind}"), name.removesuffix(_FEEDBACK)
        found = getattr(module, action)
        return found if action == name else found.Impl.FeedbackMessage
    except (ImportError, AttributeError) as error:
        expected = "a type that is installed here"
        raise WireError(type_name, expected, error, code="wire.unknown_type") from error


def message_type(message_class: Any) -> str:
    """The full name of a message class: "sensor_msgs/msg/JointState"."""
    package, kind = message_class.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_class.__name__}"


def to_cdr(store: Typestore, message: Any) -> bytes:
    """Serialize a ROS message object without rclpy."""
    name = message_type(type(message))
    return bytes(store.serialize_cdr(_converted(store, name, message), name))


@lru_cache(maxsize=64)
def _definitions(package: str) -> tuple[tuple[str, str], ...]:
    """Type and text of a package's messages and feedback, from the first prefix that has it."""
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(":")), sys.prefix]
    for prefix in prefixes:
        folder = Path(prefix) / "share" / package / "msg"
        files = sorted(folder.glob("*.msg"))
        actions = sorted(folder.with_name("action").glob("*.action"))
        if files or actions:
            messages = [(f"{package}/msg/{file.stem}", file.read_text()) for file in files]
            return (*messages, *(part for file in actions for part in _feedback(package, file)))
    return ()


def _feedback(package: str, file: Path) -> Iterator[tuple[str, str]]:
    """The two messages of an action's feedback, of which ROS installs no .msg files."""
    inner = f"{package}/msg/{file.stem}_Feedback"  # rosbags cannot write types of another folder
    yield inner, re.split(r"^---\s*$", file.read_text(), flags=re.MULTILINE)[-1]
    whole = f"unique_identifier_msgs/UUID goal_id\n{inner} feedback"
    yield f"{package}/action/{file.stem}{_FEEDBACK}", whole


def _converted(store: Typestore, type_name: str, message: Any) -> Any:
    """The message as an instance of the store's class, with NumPy arrays."""
    _, fields = store.fielddefs[type_name]
    values = {name: _field(store, kind, getattr(message, name)) for name, kind in fields}
    return store.types[type_name](**values)


def _field(store: Typestore, kind: Any, value: Any) -> Any:
    node, detail = kind
    if node == Nodetype.BASE:
        return value
    if node == Nodetype.NAME:
        return _converted(store, detail, value)
    (inner, inner_detail), _ = detail
    if inner == Nodetype.NAME:
        return [_converted(store, inner_detail, item) for item in value]
    base = inner_detail[0]
    if base in ("string", "wstring"):
        return list(value)
    return np.asarray(value, dtype=_DTYPES.get(base, base))
