"""Data sets of labelled postures (paper E, Algorithm 1): drawing, files, processes, episodes for others."""
