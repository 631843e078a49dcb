"""Calibration: a robot's parameters from its measured shapes."""
