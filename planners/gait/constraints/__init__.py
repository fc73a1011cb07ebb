"""The terms of the gait program, one a file; each is written once, over a chart.

Read ``dynamics`` (body, forces, torque, cost), then ``feet`` (footing, reach, swing, bodies).
"""
