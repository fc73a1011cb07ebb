"""Control: from a motion and measurements to joint targets, and the closed loop around it.

Read ``tracker`` (targets), ``closed_loop`` (the loop), then what it knows and does: ``estimation``,
``body_feedback``, ``foot_placement``.
"""
