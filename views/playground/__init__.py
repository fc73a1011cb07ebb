"""The playground: a course that is dragged and slid on a page, planned anew while one looks.

Read ``scenario``, ``answers``, ``playground`` and ``serving``.
"""
