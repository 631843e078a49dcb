"""Many forward solves in one call."""
