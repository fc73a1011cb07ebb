"""Reach polytopes as published, a folder a robot, each with its source and licence."""
