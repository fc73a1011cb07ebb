"""The motion that a plan stands for: what the runner executes, planning keeps clear and the
verifier judges.

Read ``motion`` (what one is, sampled and as a table), ``plan_motion``, ``gait_motion``,
``leap_motion``, then ``path`` and ``joints``, which they are made of.
"""
