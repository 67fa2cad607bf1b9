"""Start sim_node: `ros2 launch sim_node sim_node.launch.py`."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """One node; `params:=FILE` (default: learn.yaml of its share folder) and `namespace:=NAME`."""
    params = str(Path(get_package_share_directory("sim_node")) / "config" / "learn.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=params),
            DeclareLaunchArgument("namespace", default_value=""),
            Node(
                package="sim_node",
                executable="sim_node",
                name="sim_node",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
