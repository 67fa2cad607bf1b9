"""What the process environment must hold before rclpy starts: defaults, never overrides."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pa_ros.core.errors import ConfigError
from pa_ros.core.text import natural

LAST_DOMAIN = 232  # beyond it, ports would be above 65535
LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")
# Any of these says that the user has decided who may see the graph.
NETWORK_CHOICES = (
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)


def prepare_environment() -> None:
    """Set what is missing; call before `rclpy.init`. Child processes inherit it.

    Unless the user chose otherwise (NETWORK_CHOICES), the graph stays on this machine: Fast DDS
    then has loopback UDP as its only transport. ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST would
    not do, because it limits discovery alone: sockets still listen on every interface.
    """
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "ROS_LOG_DIR" not in os.environ and not _has_log_folder():
        os.environ["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / f"pa_ros-log-{os.getuid()}")
    if not any(os.environ.get(name) for name in NETWORK_CHOICES):
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(LOOPBACK_PROFILE)
        os.environ.setdefault("RMW_FASTRTPS_USE_QOS_FROM_XML", "1")  # its memory policy, too


def _has_log_folder() -> bool:
    """Whether ROS can make the one that it would log into; a container's user may have no home."""
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


def start_ros(arguments: Sequence[str]) -> None:
    """`rclpy.init`, with signals left alone. ConfigError for what it refuses: an impossible domain,
    an unreadable parameters file, a bad remap rule, a folder for logs that can't be written."""
    _check_domain()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise ConfigError(f"ROS does not start: {error}") from error


def _check_domain() -> None:
    """Raise ConfigError for a ROS_DOMAIN_ID that DDS has no ports for: rclpy would not say so."""
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    number = natural(text)
    if number is None or number > LAST_DOMAIN:
        raise ConfigError(f"ROS_DOMAIN_ID: expected 0 to {LAST_DOMAIN}, got {text!r}")
