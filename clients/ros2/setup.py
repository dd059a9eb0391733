"""Package of the ROS 2 node, for colcon."""

from pathlib import Path

from setuptools import setup

NAME = "firstfix_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME, f"{NAME}.messages", f"{NAME}.on_board", f"{NAME}.on_rclpy", f"{NAME}.robot"],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", [str(path) for path in sorted(Path().glob("launch/*.launch.*"))]),
        (f"share/{NAME}/config", ["config/first_fix.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    description="ROS 2 node that gets a LiDAR robot's first fix from a firstfix service.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"first_fix = {NAME}.node:main"]},
)
