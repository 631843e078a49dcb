"""The chi-square distribution: of squared residuals over their variances, where model and noise are as told."""

from __future__ import annotations

from typing import Any

import numpy as np


def quantile(probability: Any, freedom: Any) -> Any:
    """What a sum of so many squares stays below with a probability; numbers or arrays."""
    from scipy.special import gammaincinv

    return 2.0 * gammaincinv(0.5 * np.asarray(freedom), probability)


def tail(value: Any, freedom: Any) -> Any:
    """The probability of a sum of so many squares beyond a value; numbers or arrays."""
    from scipy.special import gammaincc

    return gammaincc(0.5 * np.asarray(freedom), 0.5 * np.asarray(value))


def p_value(chi_squared: float, freedom: int) -> float:
    """Probability of residuals so large; not a number where nothing is left over."""
    return float(tail(chi_squared, freedom)) if freedom else np.nan
