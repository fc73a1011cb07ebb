"""The command ``stancekit``: one file per command; the only layer that prints.

Read ``main`` (the table of commands), ``options`` and ``console`` (what commands share), then
``plan``; every other file is a command or a few that belong together.
"""
