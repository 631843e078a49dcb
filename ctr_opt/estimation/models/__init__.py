"""Models of experiments: residuals and observables with derivatives, in symbols and by compiled code."""
