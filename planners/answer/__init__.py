"""Answers of planners: outcomes of posture problems, plans of courses, and their files.

Read ``answer`` (a posture), ``plan`` (a course), ``certificate`` (no), ``report`` (the judgement).
"""
