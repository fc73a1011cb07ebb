"""Distributions of scenes: posture problems and courses drawn at random."""
