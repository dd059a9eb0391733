"""Launch file of the node. ``--show-args`` lists its arguments.

ros2 launch firstfix_ros first_fix.launch.py points:=/os/points imu:=/os/imu map_id:=hall
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchContext, LaunchDescription

# The node's name of a topic, by the argument that names another.
TOPICS = {
    "points": "points",
    "imu": "imu",
    "initialpose": "initialpose",
    "own_pose_topic": "own_pose",
    "tf": "/tf",
    "tf_static": "/tf_static",
    "diagnostics": "~/status",
}
# By their types: a map 7 is no number. Those that are not given are as in the file `params`.
PARAMETERS = {
    "map_id": str,
    "localizer": str,
    "version_folder": str,
    "url": str,
    "zenoh": str,
    "map_frame": str,
    "odom_frame": str,
    "base_frame": str,
    "own_pose": bool,
    "publish_tf": bool,
    "watch_s": float,
    "use_sim_time": bool,
}


def generate_launch_description() -> LaunchDescription:
    """The node with its launch arguments."""
    share = get_package_share_directory("firstfix_ros")
    arguments = [
        DeclareLaunchArgument("params", default_value=f"{share}/config/first_fix.yaml"),
        DeclareLaunchArgument("namespace", default_value=""),
        *(DeclareLaunchArgument(name, default_value=topic) for name, topic in TOPICS.items()),
        *(DeclareLaunchArgument(name, default_value="") for name in PARAMETERS),
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_node)])


def _node(context: LaunchContext) -> list[Node]:
    given = {
        name: ParameterValue(value, value_type=kind)
        for name, kind in PARAMETERS.items()
        if (value := LaunchConfiguration(name).perform(context))
    }
    return [
        Node(
            package="firstfix_ros",
            executable="first_fix",
            name="first_fix",
            namespace=LaunchConfiguration("namespace"),
            output="screen",
            parameters=[LaunchConfiguration("params"), given],
            remappings=[(topic, LaunchConfiguration(name)) for name, topic in TOPICS.items()],
        )
    ]
