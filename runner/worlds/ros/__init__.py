"""A robot behind a rosbridge (extra ``machines``).

Read ``driver``, ``bridge``, then ``joint_states``.
"""
