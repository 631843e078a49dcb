"""Stability seen two other ways: the reduced Hessian of the transcribed energy, and a Hessian by differences."""

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.polynomial import legendre
from scipy.sparse import bmat, csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.solvers.minimum import reduced_inertia
from ctr_opt.transcription.energy import EnergyProblem

MOST = 6  # eigenvalues that the inertia of the reduced Hessian tells
_MARGIN = 1e-7
_CELLS, _DEGREE, _STEP = 300, 8, 1e-3


@lru_cache
def _kkt(nlp):
    lam = ca.MX.sym("lam", nlp.g.numel())
    hessian, gradient = ca.hessian(nlp.f + ca.dot(lam, nlp.g), nlp.x)
    return ca.Function("kkt", [nlp.x, nlp.p, lam], [hessian, ca.jacobian(nlp.g, nlp.x), gradient, nlp.g])


def energy_inertia(result, transcription=None):
    """Inertia at the stationary point of the transcribed energy that Newton's method finds beside the shape."""
    problem = EnergyProblem(result.configuration, result.shape.mesh, transcription or ctr.Collocation())
    nlp, p, kkt = problem.program.nlp, problem.parameters, _kkt(problem.program.nlp)
    x, multipliers = problem.guess(result.shape), np.zeros(nlp.g.numel())
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


def hessian_by_differences(result):
    """Eigenvalues of the potential energy's Hessian over polynomial changes of all curvatures; none of the package.

    Midpoint cells, rotations multiplied up, dead forces alone; the elastic part of the Hessian is the identity.
    """
    tubes, length, n = result.robot.tubes, result.length, len(result.robot.tubes)
    width = length / _CELLS
    s = width * (np.arange(_CELLS) + 0.5)
    EI, GJ = np.array([[t.bending_stiffness, t.torsional_stiffness] for t in tubes]).T
    ends = np.array([t.length for t in tubes]) + result.actuation.translations
    here = s < ends[:, None]
    bending = EI @ here
    bent, twisted = result.curvature(s)[:, :2].T, np.zeros((n, _CELLS))
    preset = np.zeros((n, 3, _CELLS))
    for i, t in enumerate(tubes):
        twisted[i, here[i]] = result.torsion(i, s[here[i]])
        sigma = s[here[i]] - result.actuation.translations[i]
        preset[i][:, here[i]] = t.shape(sigma, t.shape.piece(sigma)).T
    base = np.array([result.tube_angle(i, 0.0) for i in range(n)])
    soft = -np.array(result.actuation.translations) / GJ
    torque, force = result.last_iterate.torsional, result.internal_force(s)
    frame = result.robot.base_pose[:3, :3]
    k = np.arange(_DEGREE)
    reach = np.array([length, length, *ends])[:, None, None]
    x = 2.0 * s / reach - 1.0
    basis = np.moveaxis(legendre.legvander(x[:, 0], _DEGREE - 1), 2, 1)
    basis = basis * (x <= 1.0) * np.sqrt((2 * k[:, None] + 1) / reach)

    def energies(c):
        """Of changes ``c (batch, (2 + n) degree + n)``."""
        modes = np.einsum("bck,cks->bcs", c[:, : (2 + n) * _DEGREE].reshape(len(c), 2 + n, _DEGREE), basis)
        entry = c[:, (2 + n) * _DEGREE :]
        u = bent + modes[:, :2] / np.sqrt(bending)
        v = twisted + modes[:, 2:] / np.sqrt(GJ)[:, None]
        psi = (base + np.sqrt(soft) * entry)[:, :, None] + width * (np.cumsum(v, axis=2) - 0.5 * v)
        total = 0.5 * ((np.sqrt(soft) * torque + entry) ** 2).sum(axis=1)
        for i in range(n):
            x = np.cos(psi[:, i]) * u[:, 0] + np.sin(psi[:, i]) * u[:, 1] - preset[i, 0]
            y = np.cos(psi[:, i]) * u[:, 1] - np.sin(psi[:, i]) * u[:, 0] - preset[i, 1]
            density = EI[i] * (x**2 + y**2) + GJ[i] * (v[:, i] - preset[i, 2]) ** 2
            total += 0.5 * width * (density * here[i]).sum(axis=1)
        turned = Rotation.from_matrix(np.tile(frame, (len(c), 1, 1)))
        half = 0.5 * width * np.concatenate((u, np.zeros((len(c), 1, _CELLS))), axis=1)
        for j in range(_CELLS):
            turned = turned * Rotation.from_rotvec(half[:, :, j])
            total -= width * (turned.as_matrix()[:, :, 2] @ force[j])
            turned = turned * Rotation.from_rotvec(half[:, :, j])
        return total

    size = (2 + n) * _DEGREE + n
    steps = _STEP * np.eye(size)
    plus, minus = steps[:, None] + steps, steps[:, None] - steps
    both = np.concatenate((plus, minus)).reshape(-1, size)
    up, down = (e.reshape(2, size, size) for e in (energies(both), energies(-both)))
    hessian = (up[0] - up[1] - down[1] + down[0]) / (4.0 * _STEP**2)
    return np.linalg.eigvalsh(hessian)
