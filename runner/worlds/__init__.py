"""Worlds: where a motion is run. A world is one file and one registration: its line in the table of
``world``.

Read ``world`` (what one is), ``simulation``, ``mujoco``, then ``bullet``, ``hardware``.
"""
