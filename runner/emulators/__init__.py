"""Emulated devices, to try drivers and plans on before anything real: a robot behind a rosbridge,
servos on a bus.
"""
