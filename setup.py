"""The packages live in top-level folders; setuptools is told so here (everything else is in
pyproject.toml).

An editable install points at `.editable`, a folder of links that reads as the installed package
does: the interpreter, type checkers and editors see the same there. `python setup.py links` makes
it anew.
"""

import os
import shutil
from pathlib import Path

from setuptools import Command, setup
from setuptools.command.editable_wheel import editable_wheel
from setuptools.command.sdist import sdist

DATA = [
    "py.typed",
    "*.yaml",
    "*.json",
    "*.safetensors",
    "*.obj",
    "*.urdf",
    "*.srdf",
    "LICENSE.txt",
    "follow.py.txt",
    "pool-*/*",
]
FOLDERS = ("planners", "runner", "views", "envs", "learners", "cli", "configs")
PAGES = [
    "CHANGELOG.md",
    "CITATION.cff",
    "constraints.txt",
    "docs/CONTRIBUTING.md",
    "docs/SECURITY.md",
]
"""What a source distribution has beside the package."""
EDITABLE = Path(".editable")


class LinkPackages(Command):
    """A package of links: the files of api/ one by one, for the other folders stand beside them."""

    description = "make .editable, which an editable install and type checkers read"
    user_options = []  # noqa: RUF012 — setuptools' own convention

    def initialize_options(self) -> None:
        """No options."""

    def finalize_options(self) -> None:
        """No options."""

    def run(self) -> None:
        """Make the links where they are not as they should be."""
        package = EDITABLE / "stancekit"
        package.mkdir(parents=True, exist_ok=True)
        wanted = {
            path.name: path
            for path in (*Path("api").glob("*.py*"), Path("api/py.typed"), *map(Path, FOLDERS))
        }
        for link in package.iterdir():
            if link.name not in wanted:
                link.unlink() if link.is_symlink() else shutil.rmtree(link)
        for name, path in wanted.items():
            if not (package / name).is_symlink():
                (package / name).symlink_to(os.path.relpath(path, package))


class Editable(editable_wheel):
    """An editable install by one line in a .pth file, which type checkers follow, too."""

    def run(self) -> None:
        """Make the links, then the line."""
        self.run_command("links")
        super().run()


class Source(sdist):
    """A source distribution with its pages."""

    def make_distribution(self) -> None:
        """Take them beside what is always there."""
        self.filelist.extend(PAGES)
        super().make_distribution()


package_dir = {
    "": str(EDITABLE),
    "stancekit": "api",
    **{f"stancekit.{folder}": folder for folder in FOLDERS},
}
packages = sorted(
    ["stancekit"]
    + [
        "stancekit." + ".".join(path.parent.parts)
        for folder in FOLDERS
        for path in Path(folder).rglob("__init__.py")
    ]
)
setup(
    packages=packages,
    package_dir=package_dir,
    package_data=dict.fromkeys(packages, DATA),
    cmdclass={"links": LinkPackages, "editable_wheel": Editable, "sdist": Source},
    options={"editable_wheel": {"mode": "compat"}, "egg_info": {"egg_base": "."}},
)
