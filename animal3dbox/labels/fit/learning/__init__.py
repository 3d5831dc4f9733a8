"""Learning keypoints' places and classes' shapes from the fits of a whole dataset."""
