"""Stage P2 (paper E §II): back onto the bilinear surface m = p·f, from a point of a relaxation."""
