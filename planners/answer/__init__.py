"""Answers of planners: outcomes of posture problems, plans of courses, and their files."""
