"""What a map of pixels does to a target: the one law, its fields and its checks."""
