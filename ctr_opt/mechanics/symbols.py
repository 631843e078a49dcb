"""The one type variable for symbolic code: a function of CasADi matrices keeps the kind it is given."""

from __future__ import annotations

from typing import TypeVar

import casadi as ca

SymT = TypeVar("SymT", ca.DM, ca.SX, ca.MX)
