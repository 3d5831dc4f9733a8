"""What is in a user's own copy of a dataset: counted and measured, nothing assumed."""
