"""Forged postures, plans, walks and proofs, and a judge of them that knows nothing of the
verifier.
"""
