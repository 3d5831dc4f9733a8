"""Names and places of keypoints: vocabularies, and where their landmarks lie on a body."""
