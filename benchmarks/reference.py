"""Reference for speeds: the paper's equations, solved with NumPy and SciPy alone.

Rucker, Jones and Webster (IEEE T-RO 2010) in their own states, curvatures: (2), (12), (19), (20), read with the
corrections of docs/explanation/theory.md, for tubes of a straight and a curved piece under a force and a moment at the
tip of the innermost. DOP853 integrates sections between break points at a relative tolerance of 1e-6; the conditions
where tubes end and at the tip are met by Newton's method with a Jacobian by differences. A solve starts from a
neighbouring one or, from nothing, by continuation in precurvature and load from the straight robot.

It avoids obvious waste: no dense output, and constants of a section are computed outside the right-hand side. There are
two versions. The textbook version has the right-hand side ``printed`` in small matrices as in the paper, and a new
Jacobian in every iteration. The tuned version has the right-hand side ``expanded`` by hand into scalars, and one
Jacobian for several iterations and steps of the continuation. It is as fast as we could make it without a compiler.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import cos, sin

import numpy as np
from scipy.integrate import DOP853

RTOL = 1e-6
DIFFERENCE = 1e-4  # of the unknowns, for the Jacobian; the integration leaves noise of about 1e-8
CONTRACTION = 0.1  # of the residual in an iteration, below which the Jacobian is used once more
ITERATIONS = 12
RESIDUAL = 0.03  # over the relative tolerance of the integration: moments left over ``max(EI) / length``
ON_THE_WAY = 1e-2  # the same at a step of the continuation, good enough for the next
FIRST_STEP, SMALLEST_STEP = 0.5, 1e-3  # of precurvature and load, from 0 to 1


@dataclass(frozen=True)
class Tubes:
    """Numbers of the tubes, inner to outer; curvature ``(u*_x, u*_y)`` of the piece behind the straight one."""

    bending: tuple[float, ...]
    torsional: tuple[float, ...]
    straight: tuple[float, ...]
    curved: tuple[float, ...]
    curvature: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Solved:
    """Tip position, m; unknown moments over ``max(EI) / length``; how many integrations it took."""

    tip_position: np.ndarray
    unknowns: np.ndarray
    integrations: int


# -- right-hand sides: states r, the axes of R_1, u_1x, u_1y, u_i,z, theta_i -------------------------------------------


def printed(bending, torsional, star, force):
    """(2), (12), (19), (20) in matrices; the tubes present have the preset curvatures ``star``."""
    count, total = len(star), sum(bending)
    tubes = [
        (np.array([e, e, g]), e / g, np.array([*u, 0.0])) for e, g, u in zip(bending, torsional, star, strict=True)
    ]
    force = np.array(force)

    def right_hand_side(_, y):
        axes, u1, uz = y[3:12].reshape(3, 3), y[12:15], y[14 : 14 + count]
        n, rates = axes @ force, np.empty(14 + 2 * count)
        right = np.array([-n[1], n[0]])
        slopes = uz - uz[0]
        for i, (stiffness, ratio, preset) in enumerate(tubes):
            c, s = cos(y[14 + count + i]), sin(y[14 + count + i])
            turn = np.array([[c, -s], [s, c]])
            slope = np.array([[-s, c], [-c, -s]])
            u = np.array([*(u1[:2] @ turn), uz[i]])
            moment = stiffness * (u - preset)
            bent = stiffness[:2] * (slopes[i] * (slope @ u1[:2]))
            crossed = np.array([u[1] * moment[2] - u[2] * moment[1], u[2] * moment[0] - u[0] * moment[2]])
            right += turn @ (bent + crossed)
            rates[14 + i] = ratio * (u[0] * preset[1] - u[1] * preset[0])
        hat = np.array([[0.0, u1[2], -u1[1]], [-u1[2], 0.0, u1[0]], [u1[1], -u1[0], 0.0]])
        rates[:3] = axes[2]
        rates[3:12] = (hat @ axes).ravel()
        rates[12:14] = right / -total
        rates[14 + count :] = slopes
        return rates

    return right_hand_side


def expanded(bending, torsional, star, force):
    """Right-hand side written out for isotropic tubes, without arrays."""
    count, total = len(star), sum(bending)
    tubes = [(e, g, e / g, *u) for e, g, u in zip(bending, torsional, star, strict=True)]
    fx, fy, fz = force

    def right_hand_side(_, y):
        y = y.tolist()
        xx, xy, xz, yx, yy, yz, zx, zy, zz, ux, uy, w = y[3:15]
        bent_x = bent_y = 0.0
        torsion, slopes = [], []
        for (e, g, ratio, kx, ky), angle, uz in zip(tubes, y[14 + count :], y[14 : 14 + count], strict=True):
            c, s = cos(angle), sin(angle)
            a, b, slope, twisted = c * ux + s * uy, c * uy - s * ux, uz - w, g * uz
            px = e * (slope * b - uz * (b - ky)) + twisted * b
            py = e * (uz * (a - kx) - slope * a) - twisted * a
            bent_x += c * px - s * py
            bent_y += s * px + c * py
            torsion.append(ratio * (a * ky - b * kx))
            slopes.append(slope)
        du_x = (yx * fx + yy * fy + yz * fz - bent_x) / total
        du_y = -(xx * fx + xy * fy + xz * fz + bent_y) / total
        dx = (w * yx - uy * zx, w * yy - uy * zy, w * yz - uy * zz)
        dy = (ux * zx - w * xx, ux * zy - w * xy, ux * zz - w * xz)
        dz = (uy * xx - ux * yx, uy * xy - ux * yy, uy * xz - ux * yz)
        return [zx, zy, zz, *dx, *dy, *dz, du_x, du_y, *torsion, *slopes]

    return right_hand_side


# -- the boundary-value problem ----------------------------------------------------------------------------------------


class Shooting:
    """The residual of one robot, actuation and load, precurvature and load multiplied by ``part``."""

    def __init__(self, tubes, actuation, load, rates, rtol=RTOL, part=1.0, reuse=True):
        self.reuse = reuse
        self.tubes, (self.rotations, self.translations) = tubes, actuation
        self.rtol, self.moment = rtol, part * np.asarray(load[1])
        begins = [t + a for t, a in zip(self.translations, tubes.straight, strict=True)]
        ends = [a + b for a, b in zip(begins, tubes.curved, strict=True)]
        if any(outer > inner for inner, outer in pairwise(ends)):
            raise ValueError("a tube reaches further than the one inside")
        breaks = sorted({0.0, *(s for s in begins + ends if s > 0.0)})
        self.unit = max(tubes.bending) / breaks[-1]
        self.sections = []
        for a, b in pairwise(breaks):
            count = sum(end >= b for end in ends)
            star = [
                (part * x, part * y) if begin <= a else (0.0, 0.0)
                for begin, (x, y) in zip(begins[:count], tubes.curvature, strict=False)
            ]
            force = tuple(part * f for f in load[0])
            function = rates(tubes.bending[:count], tubes.torsional[:count], star, force)
            scales = np.array([breaks[-1]] * 3 + [1.0] * 9 + [1.0 / breaks[-1]] * (2 + count) + [1.0] * count)
            self.sections.append((a, b, star, function, rtol * scales))
        self.tip, self.integrations = np.zeros(3), 0

    def residual(self, z):
        """Residual: torsional moments where tubes end, and the bending moment at the tip."""
        tubes, count = self.tubes, len(self.tubes.bending)
        self.integrations += 1
        uz = [self.unit * x / g for x, g in zip(z[2:].tolist(), tubes.torsional, strict=True)]
        psi = [a - b * u for a, b, u in zip(self.rotations, self.translations, uz, strict=True)]
        c, s = cos(psi[0]), sin(psi[0])
        bending = self.unit * np.array([c * z[0] + s * z[1], c * z[1] - s * z[0]])  # z: in the frame of the entry
        y = np.array([0.0, 0.0, 0.0, c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, *uz, *(p - psi[0] for p in psi)])
        left = []
        for a, b, star, function, atol in self.sections:
            if len(star) < count:
                left += [g * u for g, u in zip(tubes.torsional[len(star) : count], y[14 + len(star) :], strict=False)]
                y = np.concatenate((y[: 14 + len(star)], y[14 + count : 14 + count + len(star)]))
                count = len(star)
            stiffness = sum(tubes.bending[:count])
            y[12:14] = (bending + self._preset(y, star)) / stiffness
            solver = DOP853(function, a, y, b, rtol=self.rtol, atol=atol)
            while solver.status == "running":
                solver.step()
            if solver.status == "failed":
                raise ArithmeticError("the integration failed")
            y = solver.y
            bending = stiffness * y[12:14] - self._preset(y, star)
        tip = y[3:12].reshape(3, 3) @ self.moment
        left += [g * u for g, u in zip(tubes.torsional[:count], y[14:], strict=False)]
        left[-count] -= tip[2]
        self.tip = y[:3]
        return np.array([*(bending - tip[:2]), *left]) / self.unit

    def _preset(self, y, star):
        """Sum of ``R_theta K_i u*_i`` of the tubes present."""
        x = z = 0.0
        for e, (a, b), angle in zip(self.tubes.bending, star, y[14 + len(star) :].tolist(), strict=False):
            c, s = cos(angle), sin(angle)
            x, z = x + e * (c * a - s * b), z + e * (s * a + c * b)
        return np.array([x, z])

    def newton(self, z, tolerance, jacobian=None):
        """Unknowns and the Jacobian used last; None where Newton's method diverges. ``tip`` is that of the answer."""
        residual, fresh = self.residual(z), False
        for _ in range(ITERATIONS):
            size = np.abs(residual).max()
            if size <= tolerance:
                return z, jacobian
            if jacobian is None:
                jacobian, fresh = self.differences(z, residual), True
            trial = z - np.linalg.solve(jacobian, residual)
            after = self.residual(trial)
            contraction = np.abs(after).max() / size
            if contraction >= 1.0 and fresh:
                return None
            if contraction < 1.0:
                z, residual = trial, after
            if contraction > CONTRACTION or not self.reuse:
                jacobian = None
            fresh = False
        return None

    def differences(self, z, residual):
        """The Jacobian where the residual is known."""
        jacobian = np.empty((len(z), len(z)))
        for j in range(len(z)):
            moved = z.copy()
            moved[j] += DIFFERENCE
            jacobian[:, j] = (self.residual(moved) - residual) / DIFFERENCE
        return jacobian


def solve(tubes, actuation, load, start=None, rates=printed, rtol=RTOL, reuse=True):
    """Solve for ``actuation`` (rotations, translations) and ``load`` (force, moment at the tip, world frame).

    ``start``: a :class:`Solved` neighbour; None: from the straight robot. ``reuse``: Jacobians for several iterations.
    """
    tolerance, integrations = RESIDUAL * rtol, 0
    if start is not None:
        reached, step, z, jacobian = 0.0, 1.0, start.unknowns, None
    else:
        reached, step, z, jacobian = 0.0, FIRST_STEP, np.zeros(2 + len(tubes.bending)), None
    before = None
    while reached < 1.0:
        target = min(1.0, reached + step)
        shooting = Shooting(tubes, actuation, load, rates, rtol, target, reuse)
        guess = z if before is None else z + (target - reached) / (reached - before[0]) * (z - before[1])
        solution = shooting.newton(guess, tolerance if target == 1.0 else ON_THE_WAY, jacobian)
        integrations += shooting.integrations
        if solution is not None:
            before, reached, step = (reached, z), target, 2.0 * step
            z, jacobian = solution if reuse else (solution[0], None)
        elif start is not None or step < SMALLEST_STEP:
            raise ArithmeticError(f"Newton's method diverges at {target:.3g} of precurvature and load")
        else:
            step, jacobian = 0.5 * step, None
    return Solved(shooting.tip, z, integrations)
