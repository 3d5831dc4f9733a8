"""Which way a body points (section 2.1.1)."""
