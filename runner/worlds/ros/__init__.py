"""A robot behind a rosbridge (extra ``machines``).

Read ``driver``, ``robot``, ``bridge``, then ``joint_states``, ``estop``.
"""
