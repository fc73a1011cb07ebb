"""Experiments as YAML files, one file an experiment; typed by the dataclass that owns it."""

from pathlib import Path


def config_path(name: str) -> Path:
    """Path of a configuration file that comes with the package, e.g. ``zoo.yaml``."""
    return Path(__file__).parent / name
