"""The transforms themselves, a kind a file."""
