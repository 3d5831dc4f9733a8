"""A pickle reader that imports and calls nothing that a file names."""
