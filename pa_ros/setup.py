"""For colcon alone: `pip install` builds everything from the repository's root."""

from glob import glob

from setuptools import find_packages, setup

NAME = "pa_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["config/*.yaml", "layouts/*", "ros/*.xml", "**/*.so"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
    ],
    entry_points={"console_scripts": ["pa_ros = pa_ros.cli.main:main"]},
)
