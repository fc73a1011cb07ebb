"""What machines and hours are compared by: the same solves as in ``stancekit about``."""

from stancekit.planners.equilibrium.yardstick import yardstick as yardstick
