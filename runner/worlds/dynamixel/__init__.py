"""A robot of DYNAMIXEL X-series servos on a bus (extra ``machines``).

Read ``driver``, ``bus``, ``control_table``, then ``diagnosis``.
"""
