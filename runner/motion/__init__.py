"""Motions: plans and gaits as functions of time.

Read ``time_parametrization``, then ``redundancy``.
"""
