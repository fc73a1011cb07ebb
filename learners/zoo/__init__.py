"""Trained selectors that ship, one a class of problems, each with its card; ``selectors.shipped``
finds them.
"""
