"""Scenes of loco-3d/sl1m with their reach polytopes, and its planners without forces."""
