"""What an installation of the packages must contain, however it was made."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("sim_node", "agent_node", "learner_node", "pa_ros", "msgs_schema")

# A program that prints from where packages, their files and their libraries are loaded.
ORIGINS = f"""
import importlib, json
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from msgs_schema.msg import Program
from pa_ros.native.library import library
Program.__class__.__import_type_support__()
with open("/proc/self/maps") as maps:
    mapped = {{line.split()[-1] for line in maps if "libmsgs_schema" in line or "_fused" in line}}
names = {PACKAGES!r}
found = [get_package_prefix(n) for n in names] + [get_package_share_directory(n) for n in names]
files = [importlib.import_module(n).__path__[0] for n in names]
print(json.dumps([*found, *files, *mapped, library().__file__]))
"""


def elsewhere(origins: list[str], home: Path) -> list[str]:
    """The origins that are not under the installation's folder."""
    assert len(origins) > 3 * len(PACKAGES) + 1  # some libraries, too
    return [path for path in origins if not path.startswith(str(home))]


def missing(package: str, share: Path, *patterns: str) -> list[Path]:
    """The shared files of a package that its share folder lacks."""
    folder = ROOT / package
    patterns = ("package.xml", "launch/*.py", "config/*.yaml", *patterns)
    shared = [path.relative_to(folder) for pattern in patterns for path in folder.glob(pattern)]
    if package == "pa_ros":
        shared += [path.relative_to(folder / package) for path in folder.glob("pa_ros/layouts/*")]
    assert shared
    return [path for path in shared if not (share / path).is_file()]
