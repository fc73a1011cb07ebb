"""Damaged files: what can befall a file, and every reader of the command with a file that it
reads.
"""
