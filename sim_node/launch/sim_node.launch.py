"""Start sim_node: `ros2 launch sim_node sim_node.launch.py`"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """One node and its arguments, described (`--show-args`)."""
    params = PathJoinSubstitution([FindPackageShare("sim_node"), "config", "learn.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=params, description="parameter file"),
            DeclareLaunchArgument("namespace", default_value="", description="of the node"),
            Node(
                package="sim_node",
                executable="sim_node",
                name="sim_node",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params")],
                remappings=[("/clock", "clock")],
                output="screen",
            ),
        ]
    )
