"""From algebra to numbers; the only place that builds CasADi solvers."""
