"""Shared parts of calibration and force estimation: measurements, experiments, models with derivatives, losses."""
