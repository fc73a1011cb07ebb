"""The playground: a course that is dragged and slid on a page, planned anew while one looks.

Read ``playground``, ``serving``, ``scenario`` and ``page_parts``; the others are its kinds of pages.
"""
