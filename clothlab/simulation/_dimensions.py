"""Measures of the robot that every scene shares."""

import numpy as np

SHOULDER_POSITION = np.array([0.0, 0.0, 1.0])  # [m]
BAR_RADIUS = 0.008  # [m]
