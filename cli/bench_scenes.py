"""``stancekit bench scenes``: the field's scenes, and planners with and without forces on them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console

from stancekit.planners.errors import InvalidInput

from .bench_planner import WIDTH
from .console import emit, make_folder, out, stages
from .options import OptionalPath, OptionalText
from .pictures import show

if TYPE_CHECKING:
    from rich.table import Table


@dataclass
class BenchScenes:
    """The scenes of loco-3d/sl1m, planned by planners that know of forces and by planners that do
    not.

    l1 and mip-highs, mip-scip are sl1m's, written here as published: kinematics alone. What they
    plan is judged as any plan is: as planned, their body where they put it, and verified, where any
    body and forces will do at their feet. two-stage, exact and decoupled plan forces, too. Cells,
    plans, table and page are kept in a folder: a run that is stopped goes on where it was.
    """

    scene: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Scenes, instead of all that come with the package: names, or YAML files of scenes."""
    method: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Some of l1, mip-highs, mip-scip, two-stage, exact, decoupled; all where there is none."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="FILE|NAME")] = None
    """A robot in place of the published polytopes: anymal (boxes of reach), a .urdf file, or a
    .yaml file that names one (extra robots)."""
    reach: Annotated[OptionalPath, tyro.conf.arg(metavar="FOLDER")] = None
    """Reach polytopes in place of the scene's own."""
    time_limit_s: float = 60.0
    """Time limit of each planner on each scene [s]."""
    out: Path = Path("out/bench-scenes")
    """Folder for cells, plans, table.json, table.md and pictures."""
    pictures: bool = False
    """A picture of every plan."""
    json: bool = False
    """One JSON object a cell."""

    def run(self) -> int:
        """Measure what is missing, and write the table."""
        from stancekit.learners.evaluation import scene_bench
        from stancekit.planners.files.writing import write_text

        if self.reach is not None and not self.reach.is_dir():
            raise InvalidInput(
                f"--reach: expected a folder of reach polytopes, found none at {self.reach}"
            )
        settings = scene_bench.SceneBenchSettings(
            scenes=self.scene,
            methods=self.method or scene_bench.METHODS,
            robot=self.robot,
            reach=None if self.reach is None else str(self.reach),
            time_limit_s=self.time_limit_s,
        )
        make_folder(self.out)
        rows: list[dict[str, Any]] = []
        with stages("bench scenes") as on_progress:
            for row in scene_bench.run(settings, self.out, on_progress):
                rows.append(row)
                if self.json:
                    emit(row)
        write_text(self.out / "table.json", json.dumps(rows, indent=1) + "\n")
        write_text(self.out / "table.md", scene_bench.page(rows, settings))
        if self.pictures:
            draw(rows, self.out)
        if not self.json:
            Console(width=max(out.width, WIDTH), soft_wrap=True).print(table(rows))
            out.print(f"cells, plans and table: {self.out}")
        return 0


def table(rows: list[dict[str, Any]]) -> Table:
    """The rows as a table."""
    from rich.table import Table

    grid = Table(
        title="scenes", caption="as planned: with the planner's own body; verified: at its feet"
    )
    for name in ("scene", "method", "plan", "as planned", "verified", "status", "CPU s", "says"):
        grid.add_column(
            name, justify="right" if name == "CPU s" else "left", no_wrap=name != "says"
        )
    words = {True: "yes", False: "no", None: ""}
    for row in rows:
        grid.add_row(
            row["scene"],
            row["method"],
            words[row["success"]],
            words[row.get("as_planned")],
            words[row["verified"]],
            row["status"],
            f"{row['cpu_s']:.2f}" if "cpu_s" in row else "",
            row.get("message", "")[:60],
        )
    return grid


def draw(rows: list[dict[str, Any]], folder: Path) -> None:
    """A picture beside every plan."""
    from stancekit.files import load

    for row in rows:
        path = folder / f"{row['scene']}-{row['method']}.plan.json"
        if row["verified"] and path.exists():
            show(load(path), picture=path.with_suffix("").with_suffix(".png"))
