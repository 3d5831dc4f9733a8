"""The articulated fit: pose, shape and camera of a body together, from keypoints and a mask."""
