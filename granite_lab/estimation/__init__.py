"""From a Trial to its Motion: standstill, alignment, Kalman filter and smoother, slip."""
