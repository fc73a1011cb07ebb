"""``stancekit robot``: what a robot's file says, and what was made of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from .console import draw_to_file, emit, facts, grid, out
from .options import OptionalPath, OptionalText, check_drawn, check_unused

if TYPE_CHECKING:
    from pathlib import Path

    from rich.table import Table

    from stancekit.planners.robot.reach_sets import Workspace
    from stancekit.planners.robot.robot_model import RobotModel


@dataclass
class ShowRobot:
    """Read a robot: legs, feet, joints, limits, torques, mass, and what each foot reaches.

    Guesses are marked.

    ROBOT is a name, a .urdf file, or a .yaml file that names one and corrects it: the same wherever
    a robot is asked for. Without ROBOT the command lists the names. Legs and feet are found by
    their shape and names; a .yaml file may say them (docs/robots.md).

      stancekit robot
      stancekit robot go1 --picture go1.png

    Exit code 1 for a robot that nothing can be planned for, as with legs of two joints.

    reach: how far from its hip a foot gets. cover: share of what a foot reaches, usefully below its
    hip, that plans may use, a convex polytope; unreachable: share of that polytope that the leg
    does not reach. Proofs use an outer set that nothing reachable is outside of.
    """

    robot: Annotated[OptionalText, tyro.conf.Positional, tyro.conf.arg(metavar="ROBOT")] = None
    """A name, a .urdf file, or a .yaml file that names one; none lists the names."""
    srdf: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """SRDF file: pairs of links that may touch, and a posture to stand in."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the robot and of what its feet reach: .png, .pdf or .svg."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Read, measure, draw, say."""
        from stancekit.planners.errors import InvalidInput
        from stancekit.planners.robot.reach_sets import workspaces_of
        from stancekit.planners.robot.robot_file import named_robot

        if self.robot is None:
            return self._list()
        check_drawn(self.picture)
        model = named_robot(self.robot, srdf=self.srdf)
        workspaces: list[Workspace | None]
        try:
            workspaces, trouble = list(workspaces_of(model)), ""
        except InvalidInput as error:  # a robot whose feet stay on a surface is a robot still
            workspaces, trouble = [None] * len(model.legs), str(error)
        if self.picture is not None:
            unseen = _drawn(model, workspaces, self.picture)
            model = replace(model, doubts=(*model.doubts, *unseen))
        if self.json:
            emit(_record(model, workspaces, trouble))
            return int(bool(trouble))
        out.print(_head(model))
        for table in (_legs(model, workspaces), _joints(model)):
            out.print()
            out.print(table)
        out.print()
        for line in (
            *map("guess: {}".format, model.guesses),
            *map("doubt: {}".format, model.doubts),
        ):
            out.print(line)
        if trouble:
            out.print(f"no workspace: {trouble}")
        return int(bool(trouble))

    def _list(self) -> int:
        """Print the robots with a name, and what installs the file of each.

        Raises InvalidInput for an option.
        """
        from stancekit.planners.errors import install_command, package_command
        from stancekit.planners.robot.model import BUILT_IN
        from stancekit.planners.robot.robot_file import (
            CATALOGUE,
            as_they_come,
            catalogue,
            provider_folder,
            read_keys,
        )

        check_unused(self, ("picture", "srdf"), "the list of robots")
        named = {name: read_keys(path).provider for name, path in catalogue().items()}
        named |= {name: provider for name, provider, _ in as_they_come()}
        there = {each: provider_folder(each) is not None for each in set(named.values())}
        rows = [(name, "stancekit", True) for name in BUILT_IN]
        rows += [(name, each, there[each]) for name, each in sorted(named.items())]
        if self.json:
            for name, source, installed in rows:
                emit({"name": name, "provider": source, "installed": installed})
            return 0
        lines = (
            (
                name,
                source,
                ""
                if installed
                else install_command("catalogue")
                if source in CATALOGUE
                else package_command(source),
            )
            for name, source, installed in rows
        )
        out.print(_table(("robot", "file from", ""), lines))
        return 0


def _drawn(model: RobotModel, workspaces: list[Workspace | None], picture: Path) -> list[str]:
    """Draw the robot; doubts on meshes that should be in the picture and cannot be."""
    from stancekit.planners.robot.meshes import unseen
    from stancekit.views.robots import TRIANGLES, draw_robot

    draw_to_file(draw_robot(model, [each for each in workspaces if each is not None]), picture)
    return list(unseen(model.shapes, TRIANGLES))


def _head(model: RobotModel) -> Table:
    com = ", ".join(f"{round(float(value), 3) + 0.0:.3f}" for value in model.com_m)
    import numpy as np

    moments = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(model.inertia_kgm2))
    joints = sum(len(leg.joints) for leg in model.legs)
    rows = (
        ("robot", model.name),
        ("mass", f"{model.mass_kg:.3f} kg, centre at ({com}) m, moments {moments} kg m²"),
        ("legs", f"{len(model.legs)}, {joints} joints: {', '.join(model.leg_names)}"),
        ("stands", f"{model.stand_height_m:.3f} m above its feet"),
        (
            "may touch",
            f"{len(model.disabled_pairs)} pairs of links, by the SRDF"
            if model.disabled_pairs
            else "",
        ),
    )
    return facts(rows, "ellipsis")


def _legs(model: RobotModel, workspaces: list[Workspace | None]) -> Table:
    rows = (
        (leg.name, leg.foot, "–", "–", "–")
        if space is None
        else (
            leg.name,
            leg.foot,
            f"{space.reach_m:.3f}",
            f"{space.cover:.0%}",
            f"{space.unreachable:.2%}",
        )
        for leg, space in zip(model.legs, workspaces, strict=True)
    )
    return _table(("leg", "foot", "reach [m]", "cover", "unreachable"), rows)


def _joints(model: RobotModel) -> Table:
    rows = (
        (
            leg.name,
            joint.name,
            f"{joint.lower_rad:.2f}",
            f"{joint.upper_rad:.2f}{' m' if joint.slides else ''}",
            f"{angle:.2f}",
            f"{joint.torque_nm:g}" if joint.torque_nm > 0.0 else "–",
        )
        for leg in model.legs
        for joint, angle in zip(leg.joints, leg.stance_rad, strict=True)
    )
    return _table(("leg", "joint", "from", "to [rad]", "stands at", "torque [Nm]"), rows)


def _table(names: Sequence[str], rows: Iterable[Iterable[str]]) -> Table:
    """A table whose first two columns are words, the others numbers."""
    how = {
        name: {"justify": "left" if i < 2 else "right", "no_wrap": True}
        for i, name in enumerate(names)
    }
    return grid(how, rows, box=None)


def _record(model: RobotModel, workspaces: list[Workspace | None], trouble: str) -> dict[str, Any]:
    legs = []
    for leg, workspace in zip(model.legs, workspaces, strict=True):
        joints = [
            {
                "name": joint.name,
                "lower_rad": joint.lower_rad,
                "upper_rad": joint.upper_rad,
                "torque_nm": joint.torque_nm or None,
                "velocity_rad_s": joint.velocity_rad_s or None,
                "slides": joint.slides,
            }
            for joint in leg.joints
        ]
        record: dict[str, Any] = {
            "name": leg.name,
            "foot": leg.foot,
            "radius_m": leg.radius_m,
            "hip_m": leg.hip_m.tolist(),
            "stance_rad": leg.stance_rad.tolist(),
            "foot_m": leg.nominal_m.tolist(),
            "joints": joints,
        }
        if workspace is not None:
            record |= {
                "reach_m": workspace.reach_m,
                "cover": workspace.cover,
                "unreachable": workspace.unreachable,
                "faces": len(workspace.inner.normals),
                "ball_m": workspace.ball_m.tolist(),
                "box_m": workspace.box_m.tolist(),
            }
        legs.append(record)
    return {
        "name": model.name,
        "mass_kg": model.mass_kg,
        "com_m": model.com_m.tolist(),
        "inertia_kgm2": model.inertia_kgm2.tolist(),
        "stand_height_m": model.stand_height_m,
        "legs": legs,
        "disabled_pairs": sorted(sorted(pair) for pair in model.disabled_pairs),
        "guesses": list(model.guesses),
        "doubts": list(model.doubts),
        "no_workspace": trouble or None,
        "digest": model.digest,
    }
