"""The packages live in top-level folders; setuptools is told so here (everything else is in pyproject.toml)."""

from pathlib import Path

from setuptools import setup

FOLDERS = ("planners", "runner", "views", "envs", "learners", "cli", "configs")

package_dir = {f"stancekit.{folder}": folder for folder in FOLDERS}
packages = sorted(
    "stancekit." + ".".join(path.parent.parts) for folder in FOLDERS for path in Path(folder).rglob("__init__.py")
)
setup(
    packages=packages,
    package_dir=package_dir,
    package_data={package: ["py.typed", "*.yaml", "*.json"] for package in packages},
)
