"""A robot of DYNAMIXEL X-series servos on a bus (extra ``machines``).

Read ``driver``, ``bus``, then ``control_table``.
"""
