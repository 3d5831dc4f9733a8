"""A synthetic world of posed quadrupeds under known cameras: pictures with exact truth, the same for the same seed."""
