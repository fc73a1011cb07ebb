"""Planners: what a plan is, how to compute one and how to check one, without gymnasium and
torch.

Read ``errors`` and ``arguments`` here, then the folders from the lowest layer: ``files``,
``terrain``, ``robot``, ``problem``, ``answer``, ``motion``, ``verify``, ``equilibrium``,
``relaxation``, ``projection``, ``search``, ``warp``, ``gait``, ``leap``, ``formats``.
"""
