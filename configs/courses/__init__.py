"""Courses that come with the package, a YAML file each; typed by
``stancekit.planners.problem.course_file``.
"""
