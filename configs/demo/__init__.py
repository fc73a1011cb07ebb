"""The robot and the terrain of ``stancekit demo``."""
