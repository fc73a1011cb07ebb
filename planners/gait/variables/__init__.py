"""The decision variables (Pan et al. §III-A): phases, splines, where each entry is, and what they
are at the nodes.
"""
