"""A robot behind a rosbridge (extra ``machines``).

Read ``driver``, ``robot``, ``bridge``, then ``controller``, ``joint_states``, ``estop``.
"""
