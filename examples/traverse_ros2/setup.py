"""A package of ROS 2, and a gateway of Traverse."""

from setuptools import setup

NAME = "traverse_ros2"

setup(
    name=NAME,
    version="0.1.0",
    description="Points of a measuring arm as ROS 2 topics",
    license="Apache-2.0",
    packages=[NAME],
    python_requires=">=3.11",
    install_requires=["setuptools", "traverse-cmm"],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    entry_points={
        "console_scripts": [f"node = {NAME}.node:main"],
        "traverse.gateways": [f"ros2 = {NAME}.node:ros2"],
    },
)
