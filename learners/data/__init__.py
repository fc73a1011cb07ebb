"""Data sets of labelled postures (Algorithm E1): drawing, files, processes, episodes for others."""
