"""Loads on a robot, one file a kind: frozen, validated values in plain numpy."""
