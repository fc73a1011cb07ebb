"""Emulate a device, to try a plan on before anything real.

The robot stands as the plan begins, at rest. One JSON line says where it is reached; then every
line on standard input is a fault to happen, now or "in 2 s", an empty one asks for the state, and
either is answered with the state. Ctrl-C, SIGTERM, or the end of a pipe on standard input end it.

  python -m tests.emulators bus plan.json
  python -m tests.emulators rosbridge plan.json --port 9090
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from stancekit.planners.errors import StancekitError

from .devices import serve, shafts, start_of


@dataclass(kw_only=True)
class Bus:
    """Servos on a serial bus, which the real SDK of their maker talks to. Shafts carry nothing."""

    plan: Annotated[Path | None, tyro.conf.Positional] = None
    """Plan file: the robot stands as it begins."""
    setup: Path | None = None
    """Calibration file of the servos, with their ids, model, baud rate and directions; its port
    becomes a link to the emulated one. Without it they are as ``nominal`` has them, at ``bus``."""
    position: str = ""
    """In place of a plan: angles of all shafts [rad], separated by commas."""
    link: Path | None = None
    """Link to make to the port, in place of the calibration file's."""
    firmware: int = 45
    """Firmware of all servos: before 45 they have no Fast Sync Read, before 38 no bus watchdog."""
    seed: int = 0
    """Seed of what is drawn, e.g. of the servo that a fault hits where none is named."""
    fault: str = ""
    """A fault to happen, e.g. "silent servo 4 in 20 s"; an unknown one is answered with all."""

    def run(self) -> int:
        """Run until somebody ends it."""
        from .servo_bus import EmulatedBus

        angles, link = [float(angle) for angle in self.position.split(",") if angle], self.link
        servos = {"ids": range(1, 1 + len(angles)), "firmware": self.firmware, "seed": self.seed}
        if self.plan is not None:
            from stancekit.planners.formats.motion_file import read_motion
            from stancekit.runner.worlds.dynamixel.control_table import Calibration, nominal

            names, start = start_of(self.plan)
            calibration = (
                nominal(read_motion(self.plan)[0].robot, port="bus", desk=True)
                if self.setup is None
                else Calibration.from_yaml(self.setup, names)
            )
            angles, link = (
                shafts(calibration, names, start).tolist(),
                link or Path(calibration.port),
            )
            servos |= {
                "ids": [each.id for each in calibration.ordered(names)],
                "model": calibration.kind.number,
                "baud": calibration.baud,
            }
        if not angles:
            raise ValueError("expected a plan or --position")
        if link is not None and link.exists() and not link.is_symlink():
            raise ValueError(f"--link: expected a path for a link, got {link}, which is there")
        with EmulatedBus(position_rad=angles, **servos) as bus:
            if link is None:
                return serve({"path": bus.path}, bus, self.fault)
            link.unlink(missing_ok=True)
            link.symlink_to(bus.path)
            try:
                return serve({"port": str(link), "path": bus.path}, bus, self.fault)
            finally:
                link.unlink(missing_ok=True)


@dataclass(kw_only=True)
class Rosbridge:
    """A robot with a joint trajectory controller behind a rosbridge of ROS 1 or 2."""

    plan: Annotated[Path, tyro.conf.Positional]
    """Plan file: the robot has its joints, and stands as it begins."""
    port: int = 9090
    """TCP port to listen on, 0 for any that is free."""
    ros: Literal[1, 2] = 2
    """Version of ROS."""
    fault: str = ""
    """A fault to happen, e.g. "frozen in 20 s"; an unknown one is answered with all."""

    def run(self) -> int:
        """Run until somebody ends it."""
        from .rosbridge import RosBridge

        names, angles = start_of(self.plan)
        with RosBridge(names, angles, ros=self.ros, port=self.port) as bridge:
            where = {"port": bridge.port, "ros": self.ros, "controller": bridge.controller}
            return serve(where, bridge, self.fault)


def main() -> int:
    """Run a device; 2 after one line where it cannot be made."""
    config = (tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes)
    try:
        return tyro.cli(
            Bus | Rosbridge, prog="python -m tests.emulators", description=__doc__, config=config
        ).run()
    except (StancekitError, ValueError, OSError) as error:
        sys.stderr.write(f"emulators: error: {error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main())
