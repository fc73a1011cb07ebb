"""Stage P1 (paper E §III): convex relaxations of the posture problem, for one frame and for many."""
