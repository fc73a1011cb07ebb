"""Answers of planners: motions, proofs that there is none, and the verifier's word on them.

One solution: a ``Motion`` is a problem, the arrays that answer it, and where these are from, be it a
plan of key frames, a walk, a leap or a crossing of several parts. One judge, ``verify.judge``, and
one file, ``formats.motion_file``, take them all, and proofs, too.

Read ``answer``, ``motion`` (what all of them have), ``plan`` (key frames, leaps), ``trajectory``
(walks), ``certificate`` (no; crossings), ``report`` (the judgement).
"""
