"""The body: SMAL-structured models, their landmarks and the embedded quadruped."""
