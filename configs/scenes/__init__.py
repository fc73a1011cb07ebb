"""Published scenes, a YAML file each with source and licence; typed by
``stancekit.planners.problem.scene_keys``.
"""
