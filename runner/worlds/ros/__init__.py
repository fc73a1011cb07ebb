"""A robot behind a rosbridge (extra ``machines``).

Read ``driver``, ``robot``, ``bridge``, then ``controller``, ``goal``, ``joint_states``, ``estop``.
"""
