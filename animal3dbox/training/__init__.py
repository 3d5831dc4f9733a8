"""What supports training: samplers that can be resumed, and sanity checks of targets."""
