"""Inverse kinematics: actuations that bring the tip to positions and poses, under known loads."""
