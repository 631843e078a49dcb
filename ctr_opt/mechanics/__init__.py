"""The paper's equations in symbols, and the data they need along the arc length; independent of solvers."""
