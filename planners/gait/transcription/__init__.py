"""From terms to a nonlinear program: Taylor maps, blocks, sparse derivatives, and IPOPT, which
solves it.

Read ``program``, then ``taylor``.
"""
