"""For colcon alone: `pip install` builds everything from the repository's root."""

from glob import glob

from setuptools import find_packages, setup

NAME = "sim_node"

setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    entry_points={
        "console_scripts": [
            "sim_node = sim_node.main:main",
            "robot_node = sim_node.robot.main:main",
            "camera_node = sim_node.camera.main:main",
        ]
    },
)
