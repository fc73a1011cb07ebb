"""``stancekit emulate rosbridge``: a robot with a joint trajectory controller behind a rosbridge,
and its faults.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .options import OptionalText


@dataclass
class EmulateRosbridge:
    """A robot with a joint trajectory controller behind a rosbridge of ROS 1 or 2, on this
    machine.
    """

    plan: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN")]
    """Plan file: the robot has its joints, and stands as it begins."""
    port: int = 9090
    """TCP port to listen on, 0 for any that is free."""
    ros: Literal[1, 2] = 2
    """Version of ROS."""
    fault: OptionalText = None
    """A fault to happen, by its name; an unknown name is answered with all that there are."""
    at_s: float = 0.0
    """Seconds after the start at which it does."""

    def run(self) -> int:
        """Run until somebody ends it."""
        from stancekit.planners.errors import InvalidInput, not_installed
        from stancekit.planners.files.arrays import checked, checked_int
        from stancekit.runner.emulators.start import start_of

        try:
            from stancekit.runner.emulators.rosbridge import RosBridge
        except ImportError:
            raise not_installed(
                "emulate", "websockets", "an emulated rosbridge", "machines"
            ) from None
        from .converse import converse

        checked_int(self.port, "--port", least=0, most=65535)
        checked(self.at_s, "--at-s", least=0.0)
        names, angles = start_of(self.plan)
        try:
            made = RosBridge(names, angles.tolist(), ros=self.ros, port=self.port)
        except OSError as error:
            raise InvalidInput(
                f"--port: expected a port that is free, got {self.port}: {error.strerror}"
            ) from None
        with made as bridge:
            try:
                if self.fault is not None:
                    bridge.inject(self.fault, self.at_s)
            except ValueError as error:
                raise InvalidInput(f"--fault: {error}") from None
            where = {"port": bridge.port, "ros": self.ros, "controller": bridge.controller}
            return converse(where, bridge.inject, lambda: bridge.state() | {"log": bridge.log})
