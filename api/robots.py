"""Robots: by name, or from a file."""

from __future__ import annotations

from pathlib import Path

from stancekit.planners.arguments import checked
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.robot_file import robot_of


@checked
def robot(source: str | Path, *, srdf: str | Path | None = None) -> Robot:
    """Read a robot: its limbs, what each foot surely reaches, and its own legs, joint by joint, in
    ``model``.

    Arguments:
        source: a name ("hexapod", "go1", ...; ``stancekit robot`` lists them), a ``.urdf`` file, or
            a ``.yaml`` file that names one and corrects it.
        srdf: pairs of links that may touch, and a posture to stand in.

    Returns:
        The ``Robot``, for ``plan``, ``walk``, ``sample``, ``label``, ``terrain``. What was guessed
        about it is in ``model.remarks``; the default hexapod is its limbs alone.

    Raises:
        InvalidInput: for a name that no robot has, a file that is none, and a leg whose foot
            reaches nothing.
    Source:
        None: a URDF as it comes, with what a person corrects.

    Example:
        >>> import stancekit
        >>> stancekit.robot("hexapod").limb_names
        ('LF', 'LM', 'LR', 'RF', 'RM', 'RR')
    """
    return robot_of(source, srdf=srdf)
