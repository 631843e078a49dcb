"""Robots, problems, experiments and results as files."""
