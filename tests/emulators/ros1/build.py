"""Build a real ROS 1 robot: rosmaster, rosbridge, rosapi, and ros_control's controllers over 24
joints that lag.

    python tests/emulators/ros1/build.py FOLDER [--sources CLONES] [--install]

Debian 12 has most of ROS 1 as packages; --install gets them by apt-get. The rest is built from
sources, fetched by name with git, or taken from --sources: a folder of bare clones
``owner+name/repo``. Only ``robot_hw.cpp``, the joints, is this project's. ``benchmarks/ros1.py``
drives faults.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

HERE = Path(__file__).parent
PACKAGES = (
    "python3-rospy python3-rosmaster python3-roslaunch python3-rostopic python3-rosservice python3-rosnode "
    "python3-actionlib python3-twisted python3-autobahn python3-bson python3-cbor2 python3-pil python3-tornado "
    "python3-diagnostic-msgs python3-genpy python3-gencpp ros-std-msgs ros-sensor-msgs ros-trajectory-msgs "
    "ros-actionlib-msgs ros-geometry-msgs ros-diagnostic-msgs libsensor-msgs-dev libtrajectory-msgs-dev "
    "libactionlib-msgs-dev libgeometry-msgs-dev libstd-msgs-dev libdiagnostic-msgs-dev python3-sensor-msgs "
    "python3-trajectory-msgs python3-actionlib-msgs python3-std-msgs libroscpp-dev libactionlib-dev liburdf-dev "
    "libclass-loader-dev libangles-dev g++"
)
"""Debian packages, with spaces between them."""
SOURCES = {
    "rosbridge": ("RobotWebTools/rosbridge_suite", "ros1"),
    "ros_control": ("ros-controls/ros_control", "noetic-devel"),
    "ros_controllers": ("ros-controls/ros_controllers", "noetic-devel"),
    "realtime_tools": ("ros-controls/realtime_tools", "noetic-devel"),
    "control_msgs": ("ros-controls/control_msgs", "kinetic-devel"),
    "rosauth": ("GT-RAIL/rosauth", "develop"),
}
"""Repository and branch of every source; all of them under BSD licences."""
GENERATED = {
    "control_msgs": ("control_msgs/control_msgs", True),
    "controller_manager_msgs": ("ros_control/controller_manager_msgs", True),
    "rosauth": ("rosauth", False),
    "rosapi": ("rosbridge/rosapi", False),
    "rosbridge_msgs": ("rosbridge/rosbridge_msgs", False),
}
"""Message packages that Debian has not: their folder, and whether C++ wants them, too."""
KNOWN = (
    "std_msgs",
    "sensor_msgs",
    "trajectory_msgs",
    "actionlib_msgs",
    "geometry_msgs",
    "diagnostic_msgs",
)
PYTHON = "/usr/bin/python3"
"""Debian's, for which its packages are."""
LIBRARIES = (
    "roscpp rosconsole roscpp_serialization rostime actionlib urdf roslib class_loader xmlrpcpp boost_thread "
    "boost_system boost_filesystem pthread tinyxml2 rosconsole_bridge console_bridge"
)
"""Shared libraries of the robot, with spaces between them."""


@dataclass
class Arguments:
    """Options of the script."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Where it is built; a few ten megabytes."""
    sources: Path | None = None
    """Bare clones, owner+name/repo, in place of the network."""
    install: bool = False
    """Install Debian's packages first."""


def main(arguments: Arguments) -> None:
    """Fetch, generate, compile."""
    if arguments.install:
        _do("apt-get", "install", "-y", "--no-install-recommends", *PACKAGES.split())
    folder = arguments.folder.resolve()
    for name, (repository, branch) in SOURCES.items():
        fetched(folder / "src" / name, repository, branch, arguments.sources)
    for name, (where, cpp) in GENERATED.items():
        generated(folder, name, folder / "src" / where, cpp)
    modules(folder)
    compiled(folder)
    sys.stdout.write(f"built: {folder / 'robot_hw'}\n")


def fetched(into: Path, repository: str, branch: str, clones: Path | None) -> None:
    """The tip of a branch."""
    if into.exists():
        return
    into.mkdir(parents=True)
    if clones is None:
        _do(
            "git",
            "clone",
            "-q",
            "--depth",
            "1",
            "-b",
            branch,
            f"https://github.com/{repository}",
            str(into),
        )
        return
    clone = clones / repository.replace("/", "+") / "repo"
    archive = subprocess.run(
        ["git", "--git-dir", clone, "archive", branch], check=True, stdout=subprocess.PIPE
    ).stdout
    subprocess.run(["tar", "x", "-C", into], check=True, input=archive)


def generated(folder: Path, package: str, source: Path, cpp: bool) -> None:
    """Python modules, and headers, of a package's messages, services and actions."""
    python, headers, actions = (
        folder / "py" / package,
        folder / "include" / package,
        folder / "actions",
    )
    include = [word for name in KNOWN for word in ("-I", f"{name}:/usr/share/{name}/msg")]
    include += ["-I", f"{package}:{source / 'msg'}", "-I", f"{package}:{actions / package}"]
    for each in sorted(source.glob("action/*.action")):
        (actions / package).mkdir(parents=True, exist_ok=True)
        _do(PYTHON, "/usr/lib/actionlib_msgs/genaction.py", str(each), "-o", str(actions / package))
    files = {
        "msg": [*source.glob("msg/*.msg"), *(actions / package).glob("*.msg")],
        "srv": [*source.glob("srv/*.srv")],
    }
    for kind, found in files.items():
        into = python / kind
        into.mkdir(parents=True, exist_ok=True)
        (python / "__init__.py").touch()
        tool = f"/usr/lib/genpy/gen{kind}_py.py"
        if found:
            _do(PYTHON, tool, *map(str, sorted(found)), "-p", package, "-o", str(into), *include)
            _do(PYTHON, tool, "--initpy", "-o", str(into))
        for each in sorted(found) if cpp else []:
            generator = [PYTHON, "/usr/lib/gencpp/gen_cpp.py", str(each), *include, "-p", package]
            _do(*generator, "-o", str(headers), "-e", "/usr/share/gencpp")


def modules(folder: Path) -> None:
    """What of rosbridge is Python, beside its messages."""
    for name in ("rosapi", "rosbridge_library", "rosbridge_server"):
        source = folder / "src" / "rosbridge" / name / "src" / name
        shutil.copytree(source, folder / "py" / name, dirs_exist_ok=True)
    for script in ("rosbridge_server/scripts/rosbridge_websocket.py", "rosapi/scripts/rosapi_node"):
        shutil.copy(folder / "src" / "rosbridge" / script, folder / Path(script).name)


def compiled(folder: Path) -> None:
    """The robot: the joints here, and ros_control's manager and controllers."""
    sources = folder / "src"
    controllers = sources / "ros_controllers"
    states = controllers / "joint_state_controller/src/joint_state_controller.cpp"
    text = states.read_text(encoding="utf-8")
    if "ros::Time::MIN" in text:  # Debian's rostime is older than the sources
        states.write_text(text.replace("ros::Time::MIN", "ros::Time()"), encoding="utf-8")
    control = [
        sources / "ros_control" / each for each in ("hardware_interface", "controller_interface")
    ]
    packages = [*control, sources / "ros_control/controller_manager", sources / "realtime_tools"]
    packages += [
        controllers / each for each in ("joint_trajectory_controller", "joint_state_controller")
    ]
    folders = [
        HERE / "stub",
        Path("/usr/include/angles"),
        folder / "include",
        *(each / "include" for each in packages),
    ]
    manager = sources / "ros_control/controller_manager/src/controller_manager.cpp"
    include = [f"-I{each}" for each in folders]
    objects = []
    for source in (HERE / "robot_hw.cpp", manager, states):
        made = folder / f"{source.stem}.o"
        objects.append(str(made))
        if not made.exists() or made.stat().st_mtime < source.stat().st_mtime:
            _do("g++", "-std=c++17", "-O1", *include, "-c", str(source), "-o", str(made))
    _do(
        "g++",
        *objects,
        "-o",
        str(folder / "robot_hw"),
        *(f"-l{each}" for each in LIBRARIES.split()),
    )


def _do(*command: str) -> None:
    subprocess.run(command, check=True, env=os.environ | {"DEBIAN_FRONTEND": "noninteractive"})


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
