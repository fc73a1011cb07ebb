"""Stage P2 (Lin et al. §II): back onto the bilinear surface m = p·f, from a point of a
relaxation.
"""
