"""Stage P1 (Lin et al. §III): convex relaxations of the posture problem, for one frame and for
many.
"""
