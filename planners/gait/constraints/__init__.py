"""The terms of the gait program, one a file; each is written once, over a chart."""
