"""What the installed OpenCV can do.

4.x rounds where it reads to 1/32 px, 5.0 does not (docs/transforms.md).
"""

import cv2

OPENCV_5 = int(cv2.__version__.split(".")[0]) >= 5
RAMP_PX = 1e-3 if OPENCV_5 else 0.05
"""How far from where the matrix says a pixel may be read."""
LEVELS = 1 if OPENCV_5 else 3
"""Grey levels by which the executors may differ on fine noise, away from borders."""
