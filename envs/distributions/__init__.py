"""Distributions of scenes: posture problems and courses drawn at random.

Read ``stance`` (one scene), ``postures``, ``courses``, then ``cut``.
"""
