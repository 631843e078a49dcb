"""The chi-square distribution: the sum of squared residuals over their variances if model and noise are right."""

from __future__ import annotations

from typing import Any

import numpy as np


def quantile(probability: Any, freedom: Any) -> Any:
    """Quantile of chi-square at a probability, with ``freedom`` degrees of freedom; numbers or arrays."""
    from scipy.special import gammaincinv

    return 2.0 * gammaincinv(0.5 * np.asarray(freedom), probability)


def tail(value: Any, freedom: Any) -> Any:
    """Probability that chi-square with ``freedom`` degrees of freedom exceeds a value; numbers or arrays."""
    from scipy.special import gammaincc

    return gammaincc(0.5 * np.asarray(freedom), 0.5 * np.asarray(value))


def p_value(chi_squared: float, freedom: int) -> float:
    """Probability of residuals at least this large; not a number without degrees of freedom."""
    return float(tail(chi_squared, freedom)) if freedom else np.nan
