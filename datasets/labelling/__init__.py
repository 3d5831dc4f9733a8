"""The one way from an annotated animal to its label and target."""
