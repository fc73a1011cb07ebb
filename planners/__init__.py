"""Planners: what a plan is, how to compute one and how to check one, without gymnasium and
torch.
"""
