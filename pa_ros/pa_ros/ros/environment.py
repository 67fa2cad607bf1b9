"""The environment and the arguments that ROS starts with."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pa_ros.core.errors import ConfigError
from pa_ros.core.streams import open_standard_streams

if TYPE_CHECKING:
    from rclpy.context import Context

LAST_DOMAIN = 232  # a higher one would need ports above 65535
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")
# Any of these says that the user has decided who can see the graph.
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
OFF = "OFF"  # its value for no discovery at all
PEERS = "ROS_STATIC_PEERS"
LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"  # older; "1" makes ROS ignore the range and the peers
NETWORK_CHOICES = (
    RANGE,
    PEERS,
    "ROS_DISCOVERY_SERVER",
    PROFILE,
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)
# rcl ends a process, without a word, in which these name another middleware than the one it has.
OWN = "rmw_fastrtps_cpp"
MIDDLEWARE = ("RMW_IMPLEMENTATION", "RCL_ASSERT_RMW_ID_MATCHES")
NAMESPACE = re.compile(r"/?([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)?")
LONGEST_NAMESPACE = 200  # characters; ROS allows 247 for a topic with its namespace


def prepare_environment() -> None:
    """Set missing environment variables; call before `rclpy.init`. Child processes inherit them.

    Unless the user chose otherwise (NETWORK_CHOICES), the graph stays on this machine: the only
    transport of Fast DDS is then UDP on the loopback interface. Who asks ROS for this machine alone
    gets that, too, because ROS would only limit discovery, and listen on every interface. Closed
    standard streams are opened.
    """
    open_standard_streams()
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "ROS_LOG_DIR" not in os.environ and not _has_log_folder():
        os.environ["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / f"pa_ros-log-{os.getuid()}")
    local = _local_choices()
    if not any(os.environ.get(name) for name in NETWORK_CHOICES if name not in local):
        for name in local:
            if os.environ.get(name) != OFF:  # nodes then find nobody, as the user asked
                os.environ.pop(name, None)
        os.environ[PROFILE] = str(LOOPBACK_PROFILE)
        os.environ.setdefault("RMW_FASTRTPS_USE_QOS_FROM_XML", "1")  # for its memory policy


def _local_choices() -> tuple[str, ...]:
    """The variables that ask ROS for this machine alone, and those that ROS then ignores."""
    discovery = os.environ.get(RANGE, "")
    if os.environ.get(LOCALHOST_ONLY) == "1":
        return LOCALHOST_ONLY, RANGE, PEERS
    if discovery in ("SUBNET", "SYSTEM_DEFAULT"):
        return ()
    if discovery == OFF:
        return RANGE, PEERS
    if discovery.upper() not in ("", "LOCALHOST"):
        text = f"expected LOCALHOST, SUBNET, SYSTEM_DEFAULT or OFF, got {discovery!r}"
        print(f"{RANGE}: {text}: takes it for LOCALHOST, as ROS does", file=sys.stderr)
    return (RANGE,)


def require_ros() -> None:
    """Import rclpy; call this before anything else does. Raises ConfigError where it cannot be."""
    if sys.modules.get("rclpy") is not None:
        return
    attempt = [sys.executable, "-P", "-c", "import rclpy"]  # in a process that rcl may end
    for name in MIDDLEWARE:
        chosen = os.environ.get(name) or OWN
        if chosen != OWN and subprocess.run(attempt, capture_output=True).returncode:
            text = f"expected a middleware that is installed, such as {OWN}, got {chosen!r}"
            raise ConfigError(f"{name}: {text}: unset it")
    try:
        import rclpy  # noqa: F401
    except Exception as error:
        path, python = os.environ.get("PYTHONPATH"), sys.version.split()[0]
        reason = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
        # A ROS that is sourced sets both.
        cure = f"unset PYTHONPATH ({path}) and LD_LIBRARY_PATH" if path else "run `make install`"
        text = f"expected ROS 2 (rclpy) for Python {python}, got {reason}: {cure}"
        raise ConfigError(text) from error


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
