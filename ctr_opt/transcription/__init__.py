"""From differential to algebraic equations."""
