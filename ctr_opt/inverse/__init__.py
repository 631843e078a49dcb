"""Inverse problems, all of one kind: unknown parameters, experiments with measurements, one copy of the model each."""
