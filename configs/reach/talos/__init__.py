"""Talos, from humanoid-path-planner/talos-rbprm (v5.0.0, f8ebedd), BSD 2-Clause, see
LICENSE.txt.
"""
