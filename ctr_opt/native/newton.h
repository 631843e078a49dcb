/* Newton's method and continuation; each returns 0 only if it converged.

   Unknown are the moments (and the force) z at the entry; the tip conditions r(z) must vanish. A sweep that yields r costs
   a fraction of one that yields the Jacobian J too. So Newton's method with fresh Jacobians is only used until a step is
   short (NEARBY). From there Broyden's method updates the inverse H of the last J with each sweep,
     H += (dz - H dr) dz^T H / (dz^T H dr).
   Steps must shrink by CONTRACTION, or the method gives up.

   On the way to another branch J becomes singular. Convergence alone does not show that, so a warm start and a continuation
   both check that J stays regular between its values a and b where they come from and where they arrive. With
   M = (b - a)(b + a)^-1, a point between them is (1 - t) a + t b = (1 - M)^-1 (1 + (2t - 1) M) a: if the spectral radius
   of M is below 1, none is singular. REGULAR keeps a margin.

   A cold start follows the solution from the straight robot, where z = 0, while loads and precurvatures grow together: a
   secant predicts, Newton corrects, and the step is halved where J is not regular between two points. */

static const double CONTRACTION = 0.5, MOST_INVERSE = 1e4;
static const double REGULAR = 0.6, VERY_REGULAR = 0.2; /* the latter after steps that are long for an old Jacobian */
static const double SMALL_PART = 0.1; /* of the error allowed is what a solve may leave of the correction */
static const double CLOSE = 1e-3; /* a step so short leaves nothing that matters to a prediction */
static const double NEARBY = 1e-3, NEARLY = 1e-5; /* a step after which Broyden's method finishes; a residual before its end */

/* z - H r, and the size of the correction. */
static double correct(const double *inverse, const double *residual, double *z) {
  double step[NZ];
  multiply(NZ, NZ, 1, inverse, residual, step);
  for (int i = 0; i < NZ; i++) z[i] -= step[i];
  return norm(NZ, step);
}

/* Whether a Jacobian can be taken to have stayed regular between a and b: the eigenvalues of (b - a) (b + a)^-1 are below
   `most` in size. With REGULAR those of a^-1 b lie within 62 degrees of the positive axis and change by at most a factor
   of 4, with VERY_REGULAR 23 degrees and 1.5. */
static int regular_between(const double *a, const double *b, double most) {
  double sum[NZ * NZ], c[NZ * NZ], square[NZ * NZ];
  for (int i = 0; i < NZ; i++)
    for (int j = 0; j < NZ; j++) { /* transposed, as `solve` divides from the left */
      sum[i * NZ + j] = b[j * NZ + i] + a[j * NZ + i];
      c[i * NZ + j] = b[j * NZ + i] - a[j * NZ + i];
    }
  if (solve(NZ, NZ, sum, c)) return 0;
  double bound = norm(NZ * NZ, c), power = 1.0;
  for (int k = 0; k < 5; k++) { /* the spectral radius is at most |C^p|^(1/p) */
    if (bound < most) return 1;
    if (!(bound < 1e3)) return 0;
    multiply(NZ, NZ, NZ, c, c, square);
    memcpy(c, square, sizeof c);
    power *= 2.0;
    bound = pow(norm(NZ * NZ, c), 1.0 / power);
  }
  return 0;
}

/* -- what a solve leaves ----------------------------------------------------------------------------------------------- */

typedef struct {
  double z[NZ], residual, local, left_over; /* sum of the local errors; what is left of the correction; as positions move */
  int iterations;
  double *right, *left;          /* states behind and before the loads at the nodes */
} Solution;

/* By how much a correction of the unknowns moves positions, roughly. */
static double effect(const Case *c, const double *step) {
  const double *weight = c->track.weight;
  double sum = 0.0;
  for (int i = 0; i < NZ; i++) {
    const double moved = step[i] * (i < 2 ? weight[AT_BENDING + i] : i < 2 + TUBES ? weight[AT_TORSION + i - 2] : 1.0);
    sum += moved * moved;
  }
  return sqrt(sum);
}

/* Broyden's method from the inverse of a Jacobian nearby, one sweep an iteration. `size` is that of the first step allowed;
   nodes and errors, if asked for, are those of the last sweep. */
static int approach(const Case *c, double *inverse_, const Goal *goal, double size, Solution *solution) {
  double residual[NZ], next[NZ], step[NZ], change[NZ], moved[NZ], row[NZ];
  for (int iteration = 0; iteration < 12; iteration++) {
    const int last = iteration > 0 && solution->residual < NEARLY; /* probably */
    solution->local = 0.0;
    shoot(c, solution->z, next, solution->right, solution->left, last && solution->right ? &solution->local : NULL);
    solution->iterations++;
    solution->residual = largest(NZ, next);
    if (iteration > 0) {
      double scale = 0.0; /* the step taken is -step */
      for (int i = 0; i < NZ; i++) change[i] = next[i] - residual[i];
      multiply(NZ, NZ, 1, inverse_, change, moved);
      multiply(1, NZ, NZ, step, inverse_, row);
      for (int i = 0; i < NZ; i++) scale -= step[i] * moved[i];
      if (scale > 0.1 * size * size)
        for (int i = 0; i < NZ; i++)
          for (int j = 0; j < NZ; j++) inverse_[i * NZ + j] += (step[i] + moved[i]) * row[j] / scale;
    }
    multiply(NZ, NZ, 1, inverse_, next, step);
    solution->left_over = effect(c, step);
    if (solution->residual <= goal->residual && solution->left_over <= SMALL_PART * goal->error) {
      if (!last && solution->right) shoot(c, solution->z, next, solution->right, solution->left, &solution->local);
      return 0;
    }
    memcpy(residual, next, sizeof next);
    const double now = norm(NZ, step);
    if (!(now <= (iteration ? CONTRACTION : 1.0) * size)) return DIVERGED;
    size = now;
    for (int i = 0; i < NZ; i++) solution->z[i] -= step[i];
  }
  return DIVERGED;
}

/* Newton's method with fresh Jacobians, until Broyden's method finishes. */
static int polish(const Case *c, const Goal *goal, Solution *solution) {
  double residual[NZ], jacobian[NZ * NZ], inverse_[NZ * NZ], before = INFINITY;
  for (int iteration = 0; iteration < 6; iteration++) {
    linearize(c, solution->z, residual, jacobian, NULL);
    solution->iterations++;
    if (inverse(NZ, jacobian, inverse_) || norm(NZ * NZ, inverse_) > MOST_INVERSE) return SINGULAR;
    const double size = correct(inverse_, residual, solution->z);
    if (!(size <= (iteration ? CONTRACTION : 1.0) * before)) return DIVERGED;
    before = size;
    if (size < NEARBY) return approach(c, inverse_, goal, size, solution);
  }
  return DIVERGED;
}

/* The Jacobian at z, and the estimated error of positions: twice the distance to half the steps' length, where one chord
   step is seen at the nodes to first order. */
static int examine(const Case *c, const Case *halves, const double *z, const double *left, double *jacobian, double *error) {
  const int n = c->track.steps;
  double residual[NZ], step[NZ], inverse_[NZ * NZ], most = 0.0;
  double *positions = take(sizeof(double) * 3 * NZ * n), *fine = take(sizeof(double) * NX * 2 * n);
  if (!positions || !fine) return NO_MEMORY;
  linearize(c, z, residual, jacobian, positions);
  if (inverse(NZ, jacobian, inverse_)) return SINGULAR;
  shoot(halves, z, residual, NULL, fine, NULL);
  multiply(NZ, NZ, 1, inverse_, residual, step);
  for (int k = 0; k < n; k++) {
    double moved[3];
    for (int r = 0; r < 3; r++) {
      moved[r] = fine[(size_t)(2 * k + 1) * NX + AT_POSITION + r] - left[(size_t)k * NX + AT_POSITION + r];
      for (int i = 0; i < NZ; i++) moved[r] -= positions[((size_t)k * 3 + r) * NZ + i] * step[i];
    }
    const double size = size3(moved);
    if (!(size <= most)) most = size;
  }
  *error = 2.0 * most + 1e-12;
  return isfinite(*error) ? 0 : DIVERGED;
}

/* -- prediction from a neighbour --------------------------------------------------------------------------------------- */

typedef struct {
  double z[NZ], residual[NZ], jacobian[NZ * NZ];
} Tangent;

static void linearize_at(const Case *c, const double *z, Tangent *tangent) {
  memcpy(tangent->z, z, sizeof tangent->z);
  linearize(c, z, tangent->residual, tangent->jacobian, NULL);
}

/* The linearization as it is at a point close by. */
static void shift_to(const double *z, const Tangent *near, Tangent *tangent) {
  double step[NZ], change[NZ];
  *tangent = *near;
  for (int i = 0; i < NZ; i++) step[i] = z[i] - near->z[i];
  multiply(NZ, NZ, 1, near->jacobian, step, change);
  for (int i = 0; i < NZ; i++) tangent->residual[i] += change[i];
}

/* From z near a solution to where the tip conditions are `wanted`: one step with the inverse of an old Jacobian, then
   Newton's method. Leaves the last linearization, a step before the end, and its inverse. */
static int predict(const Case *c, const double *wanted, double *z, double *inverse_, Tangent *near, int *iterations) {
  double residual[NZ], before = 1.0;
  shoot(c, z, residual, NULL, NULL, NULL);
  for (*iterations = 1; *iterations < 6; ++*iterations) {
    for (int i = 0; i < NZ; i++) residual[i] -= wanted[i];
    const double size = correct(inverse_, residual, z);
    if (*iterations > 1 && size < CLOSE) return 0;
    if (!(size <= before)) return DIVERGED;
    before = CONTRACTION * size;
    linearize_at(c, z, near);
    memcpy(residual, near->residual, sizeof residual);
    if (inverse(NZ, near->jacobian, inverse_) || norm(NZ * NZ, inverse_) > MOST_INVERSE) return SINGULAR;
  }
  return DIVERGED;
}

/* -- continuation from the straight robot ------------------------------------------------------------------------------ */

enum { MOST_PATH_STEPS = 400 };
static const double PATH_TOLERANCE = 1e-4, SMALLEST_PATH_STEP = 1e-5;

typedef struct {
  double z[NZ], jacobian[NZ * NZ];
} Point;

/* Newton's method at a point of the path: fast or not at all. */
static int arrive(const Case *c, Point *point, int *iterations) {
  double residual[NZ], inverse_[NZ * NZ], before = INFINITY;
  for (*iterations = 0; *iterations < 5; ++*iterations) {
    linearize(c, point->z, residual, point->jacobian, NULL);
    if (inverse(NZ, point->jacobian, inverse_)) return SINGULAR;
    const double size = correct(inverse_, residual, point->z);
    if (!(size <= (*iterations ? CONTRACTION : 10.0) * before)) return DIVERGED;
    if (largest(NZ, residual) <= PATH_TOLERANCE) return 0; /* the correction just made leaves next to nothing */
    before = size;
  }
  return DIVERGED;
}

/* Follow the solution from the straight robot to the whole loads and precurvatures: see solvers/homotopy.py. */
static int follow(const Case *c, double *z, double *jacobian, int *iterations) {
  const size_t size = sizeof(double) * column_size(c->track.rk) * c->track.steps;
  double *columns = take(size);
  if (!columns) return NO_MEMORY;
  Case part;
  Point here = {0};
  double reached = 0.0, step = 0.25, before = 0.0, residual[NZ], earlier[NZ] = {0};
  int any = 0;
  scale_case(c, 0.0, columns, &part);
  linearize(&part, here.z, residual, here.jacobian, NULL);
  for (int tried = 0; reached < 1.0; tried++) {
    if (tried == MOST_PATH_STEPS || step < SMALLEST_PATH_STEP) return PATH_ENDED;
    const double target = fmin(1.0, reached + step);
    Point next = here, middle;
    int used;
    if (any)
      for (int i = 0; i < NZ; i++) next.z[i] += (target - reached) / (reached - before) * (here.z[i] - earlier[i]);
    scale_case(c, target, columns, &part);
    int failed = arrive(&part, &next, &used);
    *iterations += used + 1;
    if (!failed) {
      for (int i = 0; i < NZ; i++) middle.z[i] = 0.5 * (here.z[i] + next.z[i]);
      scale_case(c, 0.5 * (reached + target), columns, &part);
      linearize(&part, middle.z, residual, middle.jacobian, NULL);
      failed = !regular_between(here.jacobian, middle.jacobian, REGULAR) ||
               !regular_between(middle.jacobian, next.jacobian, REGULAR);
    }
    if (failed) {
      step = 0.5 * (target - reached);
      continue;
    }
    memcpy(earlier, here.z, sizeof earlier);
    before = reached;
    any = 1;
    here = next;
    reached = target;
    step *= used <= 1 ? 3.0 : used <= 2 ? 1.6 : 0.8;
  }
  memcpy(z, here.z, sizeof here.z);
  memcpy(jacobian, here.jacobian, sizeof here.jacobian);
  return 0;
}
