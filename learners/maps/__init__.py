"""Maps of where a robot can stand: poses over a terrain, proved one by one, and what is likely of
the rest.
"""
