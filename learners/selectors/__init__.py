"""Selectors: scene in, envelopes out.

Read ``selector`` (what one is, and its file), ``mixture`` and ``genetic``, then ``network``,
``neural`` and ``feasibility``.
"""
