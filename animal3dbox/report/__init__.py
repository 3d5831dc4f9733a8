"""What people look at: overlays, tables and the gallery."""
