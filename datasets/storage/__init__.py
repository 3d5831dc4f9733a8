"""Values as bytes: packed annotations, files of segments, fingerprints."""
