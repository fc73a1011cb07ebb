"""Selectors: scene in, envelopes out."""
