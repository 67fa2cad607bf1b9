"""The environment and the arguments that ROS starts with."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pa_ros.core.errors import ConfigError

if TYPE_CHECKING:
    from rclpy.context import Context

LAST_DOMAIN = 232  # a higher one would need ports above 65535
LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")
# Any of these says that the user has decided who can see the graph.
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
NETWORK_CHOICES = (
    RANGE,
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)
NAMESPACE = re.compile(r"/?([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)?")
LONGEST_NAMESPACE = 200  # characters; ROS allows 247 for a topic with its namespace


def prepare_environment() -> None:
    """Set missing environment variables; call before `rclpy.init`. Child processes inherit them.

    Unless the user chose otherwise (NETWORK_CHOICES), the graph stays on this machine: the only
    transport of Fast DDS is then UDP on the loopback interface. A range of LOCALHOST alone is that
    choice, too, and gives way to the profile: ROS would only limit discovery with it, and listen on
    every interface.
    """
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "ROS_LOG_DIR" not in os.environ and not _has_log_folder():
        os.environ["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / f"pa_ros-log-{os.getuid()}")
    chosen = {name: os.environ[name] for name in NETWORK_CHOICES if os.environ.get(name)}
    if chosen == {RANGE: "LOCALHOST"}:
        del os.environ[RANGE], chosen[RANGE]
    if not chosen:
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(LOOPBACK_PROFILE)
        os.environ.setdefault("RMW_FASTRTPS_USE_QOS_FROM_XML", "1")  # for its memory policy


def _has_log_folder() -> bool:
    """Whether ROS can use its default folder for logs. The user of a container may have no home."""
    home = os.environ.get("ROS_HOME", "")
    if not home and os.environ.get("HOME"):
        home = f"{os.environ['HOME']}/.ros"
    if not home:
        return False
    try:
        os.makedirs(f"{home}/log", exist_ok=True)
    except OSError:
        return False
    return os.access(f"{home}/log", os.W_OK)


def start_ros(
    arguments: Sequence[str], context: Context | None = None, domain: int | None = None
) -> None:
    """Call `rclpy.init`, without its signal handlers.

    :param context: None: the process's default one.
    :param domain: the ROS domain; None: ROS_DOMAIN_ID, or 0.

    Raises ConfigError for an impossible ROS_DOMAIN_ID, an unreadable parameters file, a bad remap
    rule, or a folder for logs that can't be written.
    """
    named = str(domain) if domain is not None else os.environ.get("ROS_DOMAIN_ID") or "0"
    number = int(named) if named.isdecimal() else -1
    if not 0 <= number <= LAST_DOMAIN:
        raise ConfigError(f"ROS_DOMAIN_ID: expected 0 to {LAST_DOMAIN}, got {named!r}")
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(
            args=list(arguments),
            context=context,
            domain_id=number,
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except RuntimeError as error:
        raise ConfigError(f"ROS does not start: {error}") from error


def check_namespace(text: str, what: str = "namespace") -> None:
    """Raise ConfigError, which names `what`, unless ROS accepts the text as a namespace.

    Empty text and "/" are accepted.
    """
    if len(text) > LONGEST_NAMESPACE or not NAMESPACE.fullmatch(text):
        raise ConfigError(
            f"{what}: expected a namespace such as lab/arm_1 or /lab/arm_1 (letters, digits and _, "
            f"no digit first), of at most {LONGEST_NAMESPACE} characters, "
            f"got {text[: LONGEST_NAMESPACE + 1]!r}"
        )


def ros_arguments(
    parameters: Mapping[str, object] | None = None,
    params_file: Path | str | None = None,
    namespace: str | None = None,
    name: str | None = None,
    remaps: Mapping[str, str] | None = None,
) -> list[str]:
    """Command-line arguments that give a node its parameters, namespace, name and remaps."""
    arguments = ["--ros-args"]
    if params_file is not None:
        arguments += ["--params-file", str(params_file)]
    for key, value in (parameters or {}).items():
        arguments += ["-p", f"{key}:={_yaml(value)}"]
    rules = {"__ns": namespace, "__node": name, **(remaps or {})}
    for source, target in rules.items():
        if target is not None:
            arguments += ["-r", f"{source}:={target}"]
    return arguments


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml(item) for item in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)
