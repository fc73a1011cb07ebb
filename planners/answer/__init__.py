"""Answers of planners: motions, proofs that there is none, and the verifier's word on them.

Read ``answer``, ``motion`` (what all evidence has), ``plan`` (key frames, leaps), ``trajectory``
(walks), ``certificate`` (no), ``report`` (the judgement).
"""
