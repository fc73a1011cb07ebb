"""Answers of planners: motions, proofs that there is none, and the verifier's word on them.

One solution: a ``Motion`` is a question, the columns that answer it, and where these are from, be it
a plan of key frames, a walk, a leap or a crossing of several parts. Code that differs asks which
columns there are. One judge, ``verify.judge``, and one file, ``formats.motion_file``, take them all,
and proofs, too.

Read ``answer``, ``motion``, ``plan`` (of key frames, of leaps), ``trajectory`` (what is asked of a
walk), ``certificate`` (no; what is asked of a crossing), ``report`` (the judgement).
"""
