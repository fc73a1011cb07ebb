"""A robot of DYNAMIXEL X-series servos on a bus (extra ``machines``)."""
