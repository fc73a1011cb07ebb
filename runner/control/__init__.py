"""Control: from a motion and measurements to joint targets, and the closed loop around it."""
