"""The decision variables (paper W §III-A): phases, splines, where each entry is, and what they are at the nodes."""
