"""Start the whole graph: `ros2 launch pa_ros graph.launch.py mode:=learn` (or `mode:=execute`)."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "mode": ("execute", "learn: three nodes learn 2-L; execute: two execute what is sent"),
    "namespace": ("", "of all nodes; another namespace is another arena, with a clock of its own"),
    "use_sim_time": ("false", "whether agent and learner go by the arena's clock"),
    "program": ("program", "topic of programs, remapped in all nodes"),
    "log_level": ("info", "of all nodes"),
}
NODES = {
    "sim_node": "the arena",
    "agent_node": "the agent",
    "learner_node": "the learner, in mode learn alone",
}


def generate_launch_description() -> LaunchDescription:
    """Arguments, described (`--show-args`), and the nodes; one that ends takes the others along."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    for name, what in NODES.items():
        default = [FindPackageShare(name), "/config/", LaunchConfiguration("mode"), ".yaml"]
        text = f"parameter file of {name}: {what}"
        key = name.replace("_node", "_params")
        arguments.append(DeclareLaunchArgument(key, default_value=default, description=text))
    return LaunchDescription([*arguments, *map(_node, NODES)])


def _node(name: str) -> Node:
    """One node, its parameters from its file."""
    sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    learning = EqualsSubstitution(LaunchConfiguration("mode"), "learn")
    return Node(
        package=name,
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration(name.replace("_node", "_params")),
            *([] if name == "sim_node" else [{"use_sim_time": sim_time}]),
        ],
        remappings=[("/clock", "clock"), ("program", LaunchConfiguration("program"))],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
        output="screen",
        on_exit=Shutdown(reason=f"{name} has ended"),
        condition=IfCondition(learning) if name == "learner_node" else None,
    )
