"""The motion that a plan stands for: what the runner executes, planning keeps clear and the
verifier judges.
"""
