"""A synthetic world with exact truth, its annotation faults, and its writers."""
