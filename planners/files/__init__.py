"""Files: read in bounds, written whole or not at all; and how values and files are validated.

Read ``arrays``, ``documents`` (reading), ``writing``, then ``codec`` (values by their fields).
"""
