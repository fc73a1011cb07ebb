"""Leaps: stance and flight over chosen patches, with the dynamics of one rigid body.

Read ``numbers``, ``terms`` and ``scp`` (one leap), ``finder`` (which leap), ``crossing`` (a whole
course of leaps), ``bend`` (whole bodies), ``prove``.
"""
