"""The embedded quadruped: its presets, named poses and joint limits."""
