"""Animal3D and what is written like it."""
