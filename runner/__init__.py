"""The runner: plays accepted plans on a world, simulated or real, and stops when anything is not as
it should be.

Read ``run``, ``prepared``, then ``log`` and ``report`` (what is left of a run).
"""
