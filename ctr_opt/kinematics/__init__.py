"""Inverse kinematics: from tip positions and poses to actuations, under known loads."""
