"""The inertia of the discretized energy's reduced Hessian at a given equilibrium: stability seen another way."""

import casadi as ca
import numpy as np
from scipy.sparse import bmat, csc_matrix
from scipy.sparse.linalg import splu

import ctr_opt as ctr
from ctr_opt.solvers.inertia import reduced_inertia
from ctr_opt.transcription.energy import EnergyProblem

_MARGIN = 1e-7


def energy_inertia(result, transcription=None):
    """Inertia at the stationary point of the transcribed energy that Newton's method finds beside the shape."""
    problem = EnergyProblem(result.configuration, result.shape.mesh, transcription or ctr.Collocation())
    nlp, p = problem.program.nlp, problem.parameters
    lam = ca.MX.sym("lam", nlp.g.numel())
    lagrangian = nlp.f + ca.dot(lam, nlp.g)
    hessian, gradient = ca.hessian(lagrangian, nlp.x)
    jacobian = ca.jacobian(nlp.g, nlp.x)
    kkt = ca.Function("kkt", [nlp.x, nlp.p, lam], [hessian, jacobian, gradient, nlp.g])
    x, multipliers = problem.like(result.shape), np.zeros(nlp.g.numel())
    free = problem.program.free
    for k in range(6):
        H, A, g, c = kkt(x, p, multipliers)
        H, A = csc_matrix(H.sparse()), csc_matrix(A.sparse())
        if k == 0:  # the multipliers that belong to the shape: stationary in all variables that the free ones determine
            bound = np.setdiff1d(np.arange(nlp.x.numel()), free)
            multipliers = -splu(A[:, bound].T.tocsc()).solve(g.full()[bound, 0])
            continue
        step = splu(bmat([[H, A.T], [A, None]]).tocsc()).solve(-np.concatenate((g.full()[:, 0], c.full()[:, 0])))
        if np.abs(step).max() > 0.1:
            break  # neutral: a step along the family changes nothing
        x, multipliers = x + step[: len(x)], multipliers + step[len(x) :]
    return reduced_inertia(H, A, free, problem.metric(), _MARGIN)
