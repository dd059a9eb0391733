"""Launch file of the node.

ros2 launch firstfix_ros first_fix.launch.py points:=/os/points imu:=/os/imu map_id:=hall
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

TOPICS = {"points": "points", "imu": "imu", "initialpose": "initialpose", "own_pose": "own_pose"}


def generate_launch_description() -> LaunchDescription:
    """Returns the node with its launch arguments."""
    share = get_package_share_directory("firstfix_ros")
    arguments = [
        DeclareLaunchArgument("params", default_value=f"{share}/config/first_fix.yaml"),
        DeclareLaunchArgument("map_id", description="Id of the map in the service."),
        DeclareLaunchArgument("url", default_value="http://localhost:8080"),
        *(DeclareLaunchArgument(name, default_value=topic) for name, topic in TOPICS.items()),
    ]
    node = Node(
        package="firstfix_ros",
        executable="first_fix",
        name="first_fix",
        output="screen",
        parameters=[
            LaunchConfiguration("params"),
            {"map_id": LaunchConfiguration("map_id"), "url": LaunchConfiguration("url")},
        ],
        remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
    )
    return LaunchDescription([*arguments, node])
