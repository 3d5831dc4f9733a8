"""A synthetic world of posed quadrupeds under known cameras.

Pictures with exact truth, the same for the same seed.
"""
