"""Distributions of scenes: posture problems and courses drawn at random.

Read ``postures``, ``courses``, then ``cut``.
"""
