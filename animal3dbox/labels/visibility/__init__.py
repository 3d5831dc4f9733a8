"""What the picture shows of the body itself."""
