"""``stancekit emulate``: a device that is not there, for drivers and plans to be tried on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from .emulate_bus import EmulateBus
from .emulate_rosbridge import EmulateRosbridge


@dataclass
class Emulate:
    """Emulate a device, to try a plan on before anything real: servos on a bus, or a robot behind a
    rosbridge.

    It begins where the plan does, with the robot at rest, and prints one JSON line that says where
    it is reached. Then it runs until Ctrl-C, SIGTERM, or the end of standard input where that is a
    pipe. A line on standard input is a fault to happen now, an empty one asks for the state; either
    is answered with the state, one JSON object per line.

      stancekit emulate bus plan.json --setup servos.yaml
      stancekit emulate rosbridge plan.json --port 9090
    """

    device: (
        Annotated[EmulateBus, tyro.conf.subcommand("bus", prefix_name=False)]
        | Annotated[EmulateRosbridge, tyro.conf.subcommand("rosbridge", prefix_name=False)]
    )

    def run(self) -> int:
        """Run the device until it is ended."""
        return self.device.run()
