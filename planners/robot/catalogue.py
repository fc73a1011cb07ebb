"""Robots with a name: a YAML file of this package says how each stands, the user's own packages
have the URDFs.
"""

from __future__ import annotations

from pathlib import Path

from ..errors import not_installed

PROVIDERS = {
    "example-robot-data": "cmeel.prefix/share/example-robot-data/robots",
    "pybullet": "pybullet_data",
}
"""Packages that have URDFs, of the extra ``catalogue``: the folder of the robots in each."""


def provider_folder(provider: str) -> Path | None:
    """The folder of the robots of an installed package, None where the package is not installed."""
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import

    try:
        folder = Path(str(distribution(provider).locate_file(PROVIDERS[provider])))
    except PackageNotFoundError:
        return None
    return folder if folder.is_dir() else None


def provided(provider: str, robot: str) -> Path:
    """The folder that the paths of a robot's file begin at.

    Arguments:
        provider: a package of ``PROVIDERS``.
        robot: the name of the robot, for the message.

    Raises:
        InvalidInput: where the package is not installed.
    """
    folder = provider_folder(provider)
    if folder is None:
        raise not_installed("robot", provider, f"the URDF of {robot}", "catalogue")
    return folder


def catalogue() -> dict[str, Path]:
    """The YAML file of every robot with a name, sorted by name."""
    from stancekit.configs import config_path

    files = sorted(config_path("robots/anymal.yaml").parent.glob("*.yaml"))
    return {
        path.stem: path for path in files if path.stem != "anymal"
    }  # a walker's numbers, which need no URDF
