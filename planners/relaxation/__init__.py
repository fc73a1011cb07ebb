"""Stage P1 (Lin et al. §III): convex relaxations of the posture problem, for one frame and for
many.

Read ``papers`` (the programs as written), ``envelope`` (boxes, and relaxations by name), ``mccormick``,
``lift``, then ``boxes`` and ``micp``.
"""
