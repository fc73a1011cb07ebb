"""Stage P2 (Lin et al. §II): back onto the bilinear surface m = p·f, from a point of a
relaxation.

Read ``project``, ``force_distribution`` and ``centre`` (Algorithm E1's projection), ``held``, then
``whole_body`` and ``whole_body_step``.
"""
