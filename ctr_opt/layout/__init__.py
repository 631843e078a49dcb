"""Layout along a robot: break points, sections, and the columns of numbers or symbols that describe them."""
