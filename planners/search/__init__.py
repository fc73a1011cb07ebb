"""Searches over postures."""
