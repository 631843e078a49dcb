"""Numerical solvers; the only package that builds CasADi solvers."""
