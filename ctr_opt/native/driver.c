/* What Python calls. Every function returns 0 or why it gave up; then the slower way is taken, which tells the user more. */

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { /* a result: numbers, then blocks */
  R_ITERATIONS, R_RESIDUAL, R_ERROR, R_STEPS, R_LENGTH, R_REFINEMENTS, R_NEEDED, R_COLD, R_FAR,
  HEADER = 16,
  /* The block that a solve may start from: unknowns, their Jacobian and the tip conditions there by RK4, units. */
  START = NZ + NZ * NZ + NZ + 2,
};

static const int MOST_REFINEMENTS = 3, MOST_CUTS = 3, FEW = 8; /* FEW: sweeps from nearby */
static const double SAFETY = 10.0; /* the sum of weighted local errors, so multiplied, bounds the error in all tried */

/* What Python must know to read a result. */
EXPORT int sizes(int *out) {
  const int values[] = {NX, NZ, HEADER};
  memcpy(out, values, sizeof values);
  return sizeof values / sizeof *values;
}

/* The layout of a result, its steps halved as often. */
static int again(const Robot *robot, const Loads *loads, const double *actuation, int refinements, Layout *layout) {
  Layout finer;
  int failed = lay_out(robot, loads, actuation, layout);
  for (int k = 0; k < refinements && !failed; k++) {
    failed = halve(layout, &finer);
    *layout = finer;
  }
  return failed;
}

/* A solve on ever finer meshes, from z near the solution on that of `first` and the inverse of a Jacobian nearby, until
   the error of positions is below the tolerance: by the sum of local errors or, where that is too large, by half the
   steps' length. R_ERROR is negative where it is only known to be below. The Jacobian left is that of RK4: `near`, if it is
   known close by, or a new one. `far`: the start was so far away that Broyden's method failed or was slow. */
static int refine(const Case *first, double *z, double *inverse_, const Tangent *near, const Goal *goal, int iterations,
                  int far, double *result, long capacity) {
  Case c, halves, coarse = *first;
  Layout *layout = first->layout;
  for (int refinements = 0; refinements <= MOST_REFINEMENTS; refinements++) {
    const long n = layout->steps, needed = HEADER + START + 2 * n + NX * (2 * n + 1);
    if (needed > capacity) {
      result[R_NEEDED] = needed;
      return TOO_SMALL;
    }
    double *out = result + HEADER, *mesh = out + START;
    Found found = {.iterations = iterations, .right = mesh + 2 * n, .left = mesh + 2 * n + NX * (n + 1)};
    memcpy(found.z, z, sizeof found.z);
    int failed = refinements ? 0 : pack(layout, &RK8, &c);
    if (!failed && (refinements || coarse.track.rk != &RK4)) failed = pack(layout, &RK4, &coarse);
    if (!failed) failed = approach(&c, inverse_, goal, INFINITY, &found);
    if (failed == DIVERGED) {
      memcpy(found.z, z, sizeof found.z);
      failed = polish(&c, goal, &found);
      near = NULL;
      far = 1;
    }
    if (failed) return failed;
    if (found.iterations - iterations > FEW) far = 1;
    memcpy(z, found.z, sizeof found.z);
    iterations = found.iterations;
    const double rounding = 1e-12 + 1e-15 * size3(layout->robot->position) / layout->length;
    double error = -SAFETY * found.local - 2.0 * found.left_over - rounding;
    Layout *finer = NULL;
    if (!(-error <= goal->error)) {
      finer = take(sizeof *finer);
      failed = finer ? halve(layout, finer) : NO_MEMORY;
      if (!failed) failed = pack(finer, &RK8, &halves);
      if (!failed) failed = examine(&c, &halves, z, found.left, out + NZ, &error);
      if (failed) return failed;
    }
    if (error > goal->error) {
      layout = finer;
      c = halves;
      near = NULL;
      continue;
    }
    Tangent tangent;
    if (near) shift_to(z, near, &tangent);
    else linearize_at(&coarse, z, &tangent);
    memcpy(out + NZ, tangent.jacobian, sizeof tangent.jacobian);
    memcpy(out + NZ + NZ * NZ, tangent.residual, sizeof tangent.residual);
    const double header[] = {iterations, found.residual, error, n, layout->length, refinements, needed, 0.0, far};
    memcpy(result, header, sizeof header);
    memcpy(out, found.z, sizeof found.z);
    out[START - 2] = moment_scale(layout);
    out[START - 1] = force_scale(layout);
    for (long k = 0; k < n; k++) {
      mesh[2 * k] = layout->step[k].start;
      mesh[2 * k + 1] = layout->step[k].end;
    }
    return 0;
  }
  return INACCURATE;
}

/* From an equilibrium nearby: the block `start` of its result. The change from there is found by RK4 first, as its error
   hardly changes: it leaves the same tip conditions as it did there. */
EXPORT int warm(const Robot *robot, const Loads *loads, const double *actuation, const double *start, const Goal *goal,
                double *result, long capacity) {
  empty();
  Layout layout;
  Case coarse;
  int failed = lay_out(robot, loads, actuation, &layout);
  if (!failed) failed = pack(&layout, &RK4, &coarse);
  if (failed) return failed;
  double unit[NZ], before[NZ * NZ], left[NZ], inverse_[NZ * NZ], z[NZ];
  Tangent near;
  const double *old = start + NZ, *conditions = old + NZ * NZ;
  const double moment = start[START - 2] / moment_scale(&layout), force = start[START - 1] / force_scale(&layout);
  for (int i = 0; i < NZ; i++) unit[i] = i < 2 + TUBES ? moment : force;
  for (int i = 0; i < NZ; i++) {
    z[i] = start[i] * unit[i];
    left[i] = conditions[i] * unit[i];
    for (int j = 0; j < NZ; j++) before[i * NZ + j] = old[i * NZ + j] * unit[i] / unit[j];
  }
  if (inverse(NZ, before, inverse_) || norm(NZ * NZ, inverse_) > MOST_INVERSE) return SINGULAR;
  int iterations = 0;
  const int far = predict(&coarse, left, z, inverse_, &near, &iterations);
  if (far) { /* perhaps the fine integrator gets there */
    for (int i = 0; i < NZ; i++) z[i] = start[i] * unit[i];
    inverse(NZ, before, inverse_);
  }
  failed = refine(&coarse, z, inverse_, far ? NULL : &near, goal, iterations, far, result, capacity);
  if (failed) return failed;
  const double most = result[R_FAR] != 0.0 ? VERY_REGULAR : REGULAR;
  return regular_between(before, result + HEADER + NZ, most) ? 0 : PERHAPS_ANOTHER_BRANCH;
}

/* From nothing: a coarse integrator follows the path from the straight robot and the fine one finishes; where that is too
   coarse, the fine one does both. */
EXPORT int cold(const Robot *robot, const Loads *loads, const double *actuation, const Goal *goal, double *result,
                long capacity) {
  empty();
  Layout layout;
  int failed = lay_out(robot, loads, actuation, &layout), iterations = 0;
  if (failed) return failed;
  const Tableau *ways[] = {&RK4, &RK8};
  for (int k = 0; k < 2; k++) {
    double z[NZ], jacobian[NZ * NZ], inverse_[NZ * NZ];
    Case c;
    failed = pack(&layout, ways[k], &c);
    if (!failed) failed = follow(&c, z, jacobian, &iterations);
    if (!failed && inverse(NZ, jacobian, inverse_)) failed = SINGULAR;
    if (!failed) failed = refine(&c, z, inverse_, NULL, goal, iterations, 0, result, capacity);
    if (!failed && !regular_between(jacobian, result + HEADER + NZ, REGULAR)) failed = PERHAPS_ANOTHER_BRANCH;
    if (!failed || failed == TOO_SMALL) break;
  }
  if (!failed) result[R_COLD] = 1.0;
  return failed;
}

/* Of a result, exactly: the Jacobian of the tip conditions, and behind it the estimated error of positions. */
EXPORT int inspect(const Robot *robot, const Loads *loads, const double *actuation, const double *result, double *out) {
  empty();
  Layout layout, finer;
  Case c, halves;
  int failed = again(robot, loads, actuation, (int)result[R_REFINEMENTS], &layout);
  if (!failed) failed = halve(&layout, &finer);
  if (!failed) failed = pack(&layout, &RK8, &c);
  if (!failed) failed = pack(&finer, &RK8, &halves);
  const double *block = result + HEADER, *left = block + START + 2 * layout.steps + NX * (layout.steps + 1);
  return failed ? failed : examine(&c, &halves, block, left, out, out + NZ * NZ);
}

/* How many directions lower the potential energy, -1 where that is not told; see stability.h. For loads that have one. */
EXPORT int stability(const Robot *robot, const Loads *loads, const double *actuation, const double *result, double *margin) {
  empty();
  const int refinements = (int)result[R_REFINEMENTS];
  const double *right = result + HEADER + START + 2 * (int)result[R_STEPS];
  int found = NOT_TOLD;
  for (int cuts = 0; cuts <= MOST_CUTS && found == NOT_TOLD; cuts++) { /* coarse steps may hide something */
    Layout layout;
    Case c;
    if (again(robot, loads, actuation, refinements + cuts, &layout) || pack(&layout, &RK8, &c)) return NOT_TOLD;
    found = unstable_directions(&c, right, 1 << cuts, margin);
  }
  return found;
}

/* Many solves, the first from `first`, or from nothing if that is NULL, and the others like it or, if `chained`, each from
   the one before, until one fails. Results stand `size` numbers apart; `failed` says of each what a single call would
   return. Returns how many were tried. */
EXPORT int many(const Robot *robot, const Loads *const *loads, const double *actuations, int count, const double *first,
                int chained, const Goal *goal, double *results, long size, int *failed) {
  const double *start = first;
  for (int k = 0; k < count; k++) {
    double *result = results + k * size;
    const double *actuation = actuations + k * 2 * TUBES;
    failed[k] = start ? warm(robot, loads[k], actuation, start, goal, result, size)
                      : cold(robot, loads[k], actuation, goal, result, size);
    if (chained && failed[k]) return k + 1;
    if (chained) start = result + HEADER;
  }
  return count;
}

/* Integrations from the entry to the tip, for comparison, with the derivative by the unknowns or without: the state
   there. */
EXPORT int integrate(const Robot *robot, const Loads *loads, const double *actuation, const double *z, int repeats,
                     int derivative, double *tip) {
  empty();
  Layout layout;
  Case c;
  int failed = lay_out(robot, loads, actuation, &layout);
  if (!failed) failed = pack(&layout, &RK8, &c);
  for (int k = 0; k < repeats && !failed; k++) {
    double residual[NZ], jacobian[NZ * NZ], x[NX];
    start_state(&c, z, x);
    behind(x, c.start, tip);
    if (derivative) linearize(&c, z, residual, jacobian, NULL);
    else sweep(&c.track, tip, NULL, NULL, NULL);
  }
  return failed;
}

/* Residual, predictions and their derivatives at unknowns that need not be those of an equilibrium: see model.h. The steps
   are halved so often. */
static int model(const Robot *robot, const Loads *loads, const double *actuation, const double *z, int refinements,
                 const Asked *asked, double *residual, double *slopes_, double *poses, double *rates_, double *curvatures,
                 double *curvature_rates, double *forces, double *force_rates) {
  empty();
  Layout layout;
  double scaled[NZ];
  Answer answer = {residual, slopes_, poses, rates_, curvatures, curvature_rates, forces, force_rates};
  const int failed = again(robot, loads, actuation, refinements, &layout);
  if (failed) return failed;
  for (int i = 0; i < NZ; i++) scaled[i] = z[i] / unit_of(&layout, i);
  return evaluate(&layout, scaled, asked, &answer);
}

/* The same for many experiments with as many directions and probes each; `failed` says of each what a single call would
   return. Returns how many failed. */
EXPORT int models(const Robot *robot, const Loads *const *loads, const double *actuations, const double *z, int count,
                  int refinements, const Asked *const *asked, double *residual, double *slopes_, double *poses,
                  double *rates_, double *curvatures, double *curvature_rates, double *forces,
                  double *force_rates, int *failed) {
  int failures = 0;
  for (int k = 0; k < count; k++) {
    const size_t columns = NZ + asked[k]->count, probes = asked[k]->probe_count;
    failed[k] = model(robot, loads[k], actuations + k * 2 * TUBES, z + k * NZ, refinements, asked[k], residual + k * NZ,
                      slopes_ + k * NZ * columns, poses + k * probes * 12, rates_ + k * probes * 6 * columns,
                      curvatures ? curvatures + k * probes * 3 : NULL,
                      curvature_rates ? curvature_rates + k * probes * 3 * columns : NULL,
                      forces ? forces + k * TUBES : NULL, force_rates ? force_rates + k * TUBES * columns : NULL);
    failures += failed[k] != 0;
  }
  return failures;
}

/* Pose rates of the tip of a tube (position, world turn): with rotations and translations (6 x 2 TUBES), and with a
   force and a moment in the world there (6 x 6). SI. */
EXPORT int derive(const Robot *robot, const Loads *loads, const double *actuation, const double *z, int refinements,
                  int tube, double *jacobian, double *compliance) {
  enum { COLUMNS = NZ + DERIVED };
  empty();
  Layout layout;
  double *points = take(sizeof(double) * POINT_ROW * (loads->points + 1)), pose[12];
  if (!points) return NO_MEMORY;
  const Loads more = {loads->points + 1, loads->spans, points, loads->span};
  const double row[POINT_ROW] = {NAN, tube}; /* a place without a load */
  if (loads->points) memcpy(points, loads->point, sizeof(double) * POINT_ROW * loads->points);
  memcpy(points + POINT_ROW * loads->points, row, sizeof row);
  int directions_[3 * DERIVED], *next = directions_, failed = again(robot, &more, actuation, refinements, &layout);
  if (failed) return failed;
  if (layout.ends[tube] < layout.length) return REFUSED;
  for (int k = 0; k < DERIVED; k++, next += 3) {
    const int other = k - 2 * TUBES;
    next[0] = other < 0 ? (k < TUBES ? BY_ROTATION : BY_TRANSLATION) : other < 3 ? BY_FORCE : BY_MOMENT;
    next[1] = other < 0 ? k % TUBES : loads->points;
    next[2] = other < 0 ? 0 : other % 3;
  }
  const int probe_[2] = {loads->points, tube};
  const Asked asked = {directions_, DERIVED, NULL, probe_, 1};
  double residual[NZ], slopes_[NZ * COLUMNS], rates_[6 * COLUMNS], total[6 * DERIVED];
  Answer answer = {residual, slopes_, pose, rates_, NULL, NULL, NULL, NULL};
  failed = evaluate(&layout, z, &asked, &answer);
  if (!failed) failed = total_rates(6, DERIVED, slopes_, rates_, total);
  for (int r = 0; r < 6 && !failed; r++) {
    memcpy(jacobian + r * 2 * TUBES, total + r * DERIVED, sizeof(double) * 2 * TUBES);
    memcpy(compliance + r * 6, total + r * DERIVED + 2 * TUBES, sizeof(double) * 6);
  }
  return failed;
}
