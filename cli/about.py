"""``stancekit about``: this installation and this computer, as a report of a bug needs them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .console import emit, out, progress

DOCUMENTED_S = 5.9
"""CPU time of 1,000 cold solves on the computer that measured the figures of the documentation
[s]."""


@dataclass
class About:
    """Say what is installed and how fast this computer is: for a report of a bug, and before
    figures are compared.

    Prints the version, Python, every extra with the versions of its packages and the command that
    installs a missing one, the library that draws films, the number of cores, and the CPU time of
    1,000 cold solves of one cone program beside that of the documentation's computer.

      stancekit about
      stancekit about --json
    """

    measure: bool = True
    """Measure the speed of this computer, which takes some seconds; --no-measure does not."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Look, measure, print."""
        from stancekit.runner.acceptance import about

        with progress("about") as bar:
            record = about(measure=self.measure, progress=bar)
        if self.json:
            emit(record | {"documented_s": DOCUMENTED_S})
            return 0
        for line in _lines(record):
            out.print(line, highlight=False)
        return 0


def _lines(found: dict[str, Any]) -> list[str]:
    from stancekit.planners.errors import install_command

    lines = [
        f"stancekit  {found['stancekit']}, in {found['folder']}",
        f"Python     {found['python']}, {found['platform']}",
        f"core       {_versions(found['core'])}",
    ]
    for extra, packages in found["extras"].items():
        missing = [name for name, version in packages.items() if version is None]
        text = (
            f"{install_command(extra)}  (without {', '.join(missing)})"
            if missing
            else _versions(packages)
        )
        lines.append(f"{extra:<10} {text}")
    gl = found["gl"]
    lines.append(f"GL         {gl or 'none: no films; apt-get install libegl1 libgl1'}")
    lines.append(f"cores      {found['cores']}, load {found['load']:.1f}")
    if found["solves_s"] is not None:
        ratio = found["solves_s"] / DOCUMENTED_S
        lines.append(
            f"speed      1,000 cold solves in {found['solves_s']:.2f} CPU-s, {ratio:.2f} times the "
            f"{DOCUMENTED_S:g} of the documentation's computer"
        )
    return lines


def _versions(packages: dict[str, str | None]) -> str:
    return ", ".join(f"{name} {version}" for name, version in packages.items())
