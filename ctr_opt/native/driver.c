/* The functions that Python calls. Each returns 0 or why it gave up; then the general solver runs, which reports more. */

static const int MOST_REFINEMENTS = 3, MOST_CUTS = 3, FEW = 8; /* FEW: sweeps from nearby */
static const double SAFETY = 10.0; /* the sum of weighted local errors, so multiplied, bounds the error in all tried */

/* A solve on finer and finer meshes, from z near the solution on that of `first` and the inverse of a Jacobian nearby, until
   the error of positions is below the tolerance: by the sum of local errors or, if that is too large, by half the step
   length. R_ERROR is negative if only an upper bound is known. The Jacobian left is that of RK4: `near`, if it is known
   close by, or a new one. `far`: the start was so far away that Broyden's method failed or was slow. */
static int refine(const Case *first, double *z, double *inverse_, const Tangent *near, const Goal *goal, int iterations,
                  int far, double *result, long capacity) {
  Case c, halves, coarse = *first;
  Layout *layout = first->layout;
  for (int refinements = 0; refinements <= MOST_REFINEMENTS; refinements++) {
    const long n = layout->steps, needed = RESULT_SIZE(n);
    if (needed > capacity) {
      result[R_NEEDED] = needed;
      return TOO_SMALL;
    }
    double *out = result + RESULT_START(n), *jacobian = out + START_JACOBIAN, *mesh = result + RESULT_MESH(n);
    Solution solution = {.iterations = iterations, .right = result + RESULT_RIGHT(n), .left = result + RESULT_LEFT(n)};
    memcpy(solution.z, z, sizeof solution.z);
    int failed = refinements ? 0 : pack(layout, &RK8, &c);
    if (!failed && (refinements || coarse.track.rk != &RK4)) failed = pack(layout, &RK4, &coarse);
    if (!failed) failed = approach(&c, inverse_, goal, INFINITY, &solution);
    if (failed == DIVERGED) {
      memcpy(solution.z, z, sizeof solution.z);
      failed = polish(&c, goal, &solution);
      near = NULL;
      far = 1;
    }
    if (failed) return failed;
    if (solution.iterations - iterations > FEW) far = 1;
    memcpy(z, solution.z, sizeof solution.z);
    iterations = solution.iterations;
    const double rounding = 1e-12 + 1e-15 * size3(layout->robot->position) / layout->length;
    double error = -SAFETY * solution.local - 2.0 * solution.left_over - rounding;
    Layout *finer = NULL;
    if (!(-error <= goal->error)) {
      finer = take(sizeof *finer);
      failed = finer ? halve(layout, finer) : NO_MEMORY;
      if (!failed) failed = pack(finer, &RK8, &halves);
      if (!failed) failed = examine(&c, &halves, z, solution.left, jacobian, &error);
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
    memcpy(jacobian, tangent.jacobian, sizeof tangent.jacobian);
    memcpy(out + START_CONDITIONS, tangent.residual, sizeof tangent.residual);
    const double head[] = {
        [R_ITERATIONS] = iterations, [R_RESIDUAL] = solution.residual, [R_ERROR] = error, [R_STEPS] = n,
        [R_LENGTH] = layout->length, [R_REFINEMENTS] = refinements, [R_NEEDED] = needed, [R_COLD] = 0.0, [R_FAR] = far,
        [R_STEPS_OF_PATH] = 0.0};
    memcpy(result, head, sizeof head);
    memcpy(out, solution.z, sizeof solution.z);
    out[START_UNITS] = moment_scale(layout);
    out[START_UNITS + 1] = force_scale(layout);
    memcpy(out + START_ROTATIONS, layout->rotations, sizeof(double) * TUBES);
    for (long k = 0; k < n; k++) {
      mesh[2 * k] = layout->step[k].start;
      mesh[2 * k + 1] = layout->step[k].end;
    }
    return 0;
  }
  return INACCURATE;
}

/* Whether tubes turn by more than half a turn in each other. Whole turns do not change equilibrium and Jacobian, so a
   comparison of Jacobians would miss the folds that such a step passes. */
static int turned_far(const double *from, const double *to) {
  double least = INFINITY, most = -INFINITY;
  for (int i = 0; i < TUBES; i++) {
    least = fmin(least, to[i] - from[i]);
    most = fmax(most, to[i] - from[i]);
  }
  return most - least > 3.141592653589793;
}

/* From an equilibrium nearby: the block `start` of its result. The change from there is found by RK4 first, as its error
   hardly changes: it leaves the same tip conditions as it did there. */
static int step_from(const Robot *robot, const Loads *loads, const double *actuation, const double *start,
                     const Goal *goal, double *result, long capacity) {
  empty();
  Layout layout;
  Case coarse;
  int failed = turned_far(start + START_ROTATIONS, actuation) ? PERHAPS_ANOTHER_BRANCH : 0;
  if (!failed) failed = lay_out(robot, loads, actuation, &layout);
  if (!failed) failed = pack(&layout, &RK4, &coarse);
  if (failed) return failed;
  double unit[NZ], before[NZ * NZ], left[NZ], inverse_[NZ * NZ], z[NZ];
  Tangent near;
  const double *old = start + START_JACOBIAN, *conditions = start + START_CONDITIONS, *units = start + START_UNITS;
  const double moment = units[0] / moment_scale(&layout), force = units[1] / force_scale(&layout);
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
  return regular_between(before, result + RESULT_START(0) + START_JACOBIAN, most) ? 0 : PERHAPS_ANOTHER_BRANCH;
}

EXPORT int warm(const Robot *robot, const Loads *loads, const double *actuation, const double *start, const Goal *goal,
                double *result, long capacity) {
  return step_from(robot, loads, actuation, start, goal, result, capacity);
}

/* -- continuation from an equilibrium ------------------------------------------------------------------------------------ */

enum { MOST_TRAVEL_STEPS = 400 };
static const double SMALLEST_TRAVEL_STEP = 1e-5, ON_THE_WAY = 1e-4; /* of the way; errors over the length until its end */

/* Add the loads of one end of the way, multiplied. One that would fall off its tube stays at its end. */
static void add_loads(const Loads *from, double factor, const double *ends, Loads *to, PointLoad *points, SpanLoad *spans) {
  for (int k = 0; k < from->points; k++) {
    PointLoad load = from->point[k];
    if (load.s > ends[(int)load.tube]) load.s = NAN;
    for (int r = 0; r < 3; r++) {
      load.force[r] *= factor;
      load.moment[r] *= factor;
    }
    points[to->points++] = load;
  }
  for (int k = 0; k < from->spans; k++) {
    SpanLoad load = from->span[k];
    const double end = ends[(int)load.tube];
    if (load.ends[0] >= end) continue;
    if (load.ends[1] > end) load.ends[1] = NAN;
    for (int r = 0; r < 3; r++) {
      load.force[r] *= factor;
      load.moment[r] *= factor;
    }
    spans[to->spans++] = load;
  }
}

/* Follow the equilibrium `start`, at actuation `from` under `from_loads`, to another actuation and other loads: the
   actuation changes linearly, the loads of the start fade and the others grow. Each step is a warm solve that stays on the
   branch; refused steps are halved. */
EXPORT int travel(const Robot *robot, const Loads *from_loads, const double *from, const Loads *loads,
                  const double *actuation, const double *start, const Goal *goal, double *result, long capacity) {
  const Goal coarse = {fmax(goal->error, ON_THE_WAY), fmax(goal->residual, ON_THE_WAY)};
  const size_t points = (size_t)from_loads->points + loads->points, spans = (size_t)from_loads->spans + loads->spans;
  PointLoad *point = malloc(sizeof(PointLoad) * (points + 1)); /* not in the arena, which every solve empties */
  SpanLoad *span = malloc(sizeof(SpanLoad) * (spans + 1));
  double here[START_SIZE], there[2 * TUBES], reached = 0.0, step = 0.5;
  int failed = point && span ? 0 : NO_MEMORY, taken = 0;
  memcpy(here, start, sizeof here);
  for (int tried = 0; !failed && reached < 1.0; tried++) {
    if (tried == MOST_TRAVEL_STEPS || step < SMALLEST_TRAVEL_STEP) {
      failed = PATH_ENDED;
      break;
    }
    const double target = fmin(1.0, reached + step);
    double ends[TUBES];
    for (int i = 0; i < 2 * TUBES; i++) there[i] = from[i] + target * (actuation[i] - from[i]);
    for (int i = 0; i < TUBES; i++) {
      if (target == 1.0) there[TUBES + i] = actuation[TUBES + i];
      there[TUBES + i] = fmin(there[TUBES + i], 0.0);
      ends[i] = there[TUBES + i] + robot->breaks[robot->pieces[i + 1] + i];
    }
    Loads between = {0, 0, point, span};
    const Loads *now = target == 1.0 || from_loads == loads ? loads : &between;
    if (now == &between || target < 1.0) {
      if (from_loads != loads) add_loads(from_loads, 1.0 - target, ends, &between, point, span);
      add_loads(loads, from_loads == loads ? 1.0 : target, ends, &between, point, span);
      now = &between;
    }
    const int refused = step_from(robot, now, there, here, target == 1.0 ? goal : &coarse, result, capacity);
    if (refused == TOO_SMALL || refused == NO_MEMORY) failed = refused;
    else if (refused) step = 0.5 * (target - reached);
    else {
      memcpy(here, result + RESULT_START((int)result[R_STEPS]), sizeof here);
      reached = target;
      step *= 2.0;
      taken++;
    }
  }
  free(point);
  free(span);
  if (!failed || failed == PATH_ENDED) result[R_STEPS_OF_PATH] = taken;
  if (failed == PATH_ENDED) result[R_REACHED] = reached;
  return failed;
}

/* A cold start: a coarse integrator follows the path from the straight robot and the fine one finishes. If the coarse one
   is too coarse, the fine one does both. */
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
    if (!failed && !regular_between(jacobian, result + RESULT_START(0) + START_JACOBIAN, REGULAR))
      failed = PERHAPS_ANOTHER_BRANCH;
    if (!failed || failed == TOO_SMALL) break;
  }
  if (!failed) result[R_COLD] = 1.0;
  return failed;
}

/* Exact values for a result: the Jacobian of the tip conditions, and behind it the estimated error of positions. */
EXPORT int inspect(const Robot *robot, const Loads *loads, const double *actuation, const double *result, double *out) {
  empty();
  Layout layout, finer;
  Case c, halves;
  int failed = again(robot, loads, actuation, (int)result[R_REFINEMENTS], &layout);
  if (!failed) failed = halve(&layout, &finer);
  if (!failed) failed = pack(&layout, &RK8, &c);
  if (!failed) failed = pack(&finer, &RK8, &halves);
  const double *z = result + RESULT_START(layout.steps), *left = result + RESULT_LEFT(layout.steps);
  return failed ? failed : examine(&c, &halves, z, left, out, out + NZ * NZ);
}

/* Number of directions that lower the potential energy, -1 if undecided; see stability.h. Loads must have a potential. */
EXPORT int stability(const Robot *robot, const Loads *loads, const double *actuation, const double *result, double *margin) {
  empty();
  const int refinements = (int)result[R_REFINEMENTS];
  const double *right = result + RESULT_RIGHT((int)result[R_STEPS]);
  int negative = UNDECIDED;
  for (int cuts = 0; cuts <= MOST_CUTS && negative == UNDECIDED; cuts++) { /* coarse steps may hide something */
    Layout layout;
    Case c;
    if (again(robot, loads, actuation, refinements + cuts, &layout) || pack(&layout, &RK8, &c)) return UNDECIDED;
    negative = unstable_directions(&c, right, 1 << cuts, margin);
  }
  return negative;
}

/* Many solves, the first from `first`, or cold if that is NULL. The others do the same or, if `chained`, start each from
   the one before, until one fails. Results are `size` numbers apart; `failed` contains what single calls would return.
   Returns the number of solves tried. */
EXPORT int many(const Robot *robot, const Loads *const *loads, const double *actuations, int count, const double *first,
                int chained, const Goal *goal, double *results, long size, int *failed) {
  const double *start = first;
  for (int k = 0; k < count; k++) {
    double *result = results + k * size;
    const double *actuation = actuations + k * 2 * TUBES;
    failed[k] = start ? warm(robot, loads[k], actuation, start, goal, result, size)
                      : cold(robot, loads[k], actuation, goal, result, size);
    if (chained && failed[k]) return k + 1;
    if (chained) start = result + RESULT_START(0);
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

/* Residual, predictions and their derivatives at unknowns that need not be those of an equilibrium: see model.h. All steps
   are halved `refinements` times. Where break points coincide, derivatives are those from the `side`: see sided.h. For many
   experiments with equal numbers of directions and probes; `failed` contains why each failed. Returns the number of
   failures. */
EXPORT int models(const Robot *robot, const Loads *const *loads, const double *actuations, const double *z, int count,
                  int refinements, int side, const Asked *asked, const Answer *answers, int *failed) {
  int failures = 0;
  for (int k = 0; k < count; k++) {
    Answer answer = answer_of(answers, k, NZ + asked->count, asked->probe_count);
    Asked here = *asked;
    Setting setting = {robot, *loads[k], .refinements = refinements, .tip = -1, .same = 1.0, .beyond = 1.0};
    here.directions += (size_t)k * asked->count;
    here.probes += (size_t)k * asked->probe_count;
    memcpy(setting.actuation, actuations + k * 2 * TUBES, sizeof setting.actuation);
    empty();
    failed[k] = evaluate_sided(&setting, z + k * NZ, &here, side, &answer);
    failures += failed[k] != 0;
  }
  return failures;
}

/* The values at `count` places in ascending order, PLACE_SIZE numbers each, dimensionless; `left`: limits from the left. */
EXPORT int sample(const Robot *robot, const Loads *loads, const double *actuation, const double *result, int count,
                  const double *s, const int *left, double *values) {
  empty();
  Layout layout, places;
  Case c;
  int *node = take(sizeof(int) * count);
  int failed = node ? again(robot, loads, actuation, (int)result[R_REFINEMENTS], &layout) : NO_MEMORY;
  if (!failed && layout.steps != (int)result[R_STEPS]) failed = REFUSED;
  if (!failed) failed = step_to_places(&layout, count, s, left, &places, node);
  if (!failed) failed = pack(&places, &RK8, &c);
  if (failed) return failed;
  const double *right = result + RESULT_RIGHT(layout.steps), *before = result + RESULT_LEFT(layout.steps);
  const int size = column_size(&RK8), last = last_node(&RK8);
  for (int k = 0; k < count; k++) {
    const double *column = c.columns + (size_t)k * size, *data[PARTS];
    double *value = values + (size_t)k * PLACE_SIZE, *x = value + PLACE_STATE;
    const int ends = s[k] >= layout.step[node[k]].end;
    memcpy(x, ends ? before + (size_t)node[k] * NX : right + (size_t)node[k] * NX, sizeof(double) * NX);
    if (!ends && column[0] > 0.0) advance(&c.track, column, c.flags[k], x, NULL);
    at_node(&c.track, column, last, data);
    at_place(x, data, value + PLACE_BENT, value + PLACE_TWISTED, value + PLACE_MOMENTS, value + PLACE_ENERGY);
  }
  return 0;
}

/* Force on a tube's base against advancing or drawing it back. */
EXPORT int push(const Robot *robot, const Loads *loads, const double *actuation, const double *z, int refinements,
                int tube, int side, double *force) {
  empty();
  Layout layout;
  Setting setting = {robot, *loads, .refinements = refinements, .tip = -1, .same = 1.0, .beyond = 1.0}, beside;
  memcpy(setting.actuation, actuation, sizeof setting.actuation);
  const Asked nothing = {.count = 0, .probe_count = 0};
  double residual[NZ], slopes_[NZ * NZ], forces[TUBES], rates_[TUBES * NZ];
  Answer answer = {.residual = residual, .slopes = slopes_, .forces = forces, .force_rates = rates_};
  int failed = set_up(&setting, &layout);
  if (!failed && layout.tied[tube]) failed = set_apart(&setting, layout.length, tube, side, &beside, &layout);
  if (!failed) failed = evaluate_si(&layout, z, &nothing, IDLE, &answer);
  *force = forces[tube];
  return failed;
}

/* Pose rates (position, world turn) at an arc length, or at the tip if that is NaN: with rotations and translations (6 x 2
   TUBES), and with a force and a moment in the world (6 x 6) on a tube at an arc length, or at its end if that is NaN. The
   pose is that of the tube `frame`, or INNERMOST. Also those of the unknowns with rotations and translations (NZ x 2
   TUBES), and which tubes' break points coincide with others. SI, but for the unknowns z at the solution. */
EXPORT int derive(const Robot *robot, const Loads *loads, const double *actuation, const double *z, int refinements,
                  int side, double s, int frame, double load_at, int tube, double *jacobian, double *compliance, double *unknowns,
                  int *coincide) {
  empty();
  const int mark = loads->points;
  PointLoad *points = take(sizeof(PointLoad) * (mark + 2));
  if (!points) return NO_MEMORY;
  if (mark) memcpy(points, loads->point, sizeof(PointLoad) * mark);
  points[mark] = (PointLoad){.s = s, .tube = 0};
  points[mark + 1] = (PointLoad){.s = load_at, .tube = tube};
  Setting setting = {robot, {mark + 2, loads->spans, points, loads->span}, .refinements = refinements, .tip = mark, .same = 1.0, .beyond = 1.0}, beside;
  memcpy(setting.actuation, actuation, sizeof setting.actuation);
  Direction directions_[DERIVED];
  for (int k = 0; k < DERIVED; k++) {
    const int other = k - 2 * TUBES;
    if (other < 0) directions_[k] = (Direction){k < TUBES ? BY_ROTATION : BY_TRANSLATION, k % TUBES, 0};
    else directions_[k] = (Direction){other < 3 ? BY_FORCE : BY_MOMENT, mark + 1, other % 3};
  }
  const Probe probe_ = {mark, frame};
  const Asked asked = {.directions = directions_, .count = DERIVED, .probes = &probe_, .probe_count = 1};
  Layout layout, there;
  double si[NZ], total[6 * DERIVED], change[NZ * DERIVED], sided[6 * DERIVED], sided_change[NZ * DERIVED];
  int failed = set_up(&setting, &layout);
  for (int i = 0; i < NZ && !failed; i++) si[i] = z[i] * unit_of(&layout, i);
  if (!failed) failed = pose_derivatives(&layout, si, &asked, IDLE, change, total);
  for (int i = 0; i < TUBES && !failed; i++) {
    coincide[i] = layout.tied[i];
    if (!two_sided(&layout, &asked, i, side)) continue;
    const int column = TUBES + i;
    failed = set_apart(&setting, layout.length, i, side, &beside, &there);
    if (!failed) failed = pose_derivatives(&there, si, &asked, i, sided_change, sided);
    for (int r = 0; r < 6 && !failed; r++) total[r * DERIVED + column] = sided[r * DERIVED + column];
    for (int r = 0; r < NZ && !failed; r++) change[r * DERIVED + column] = sided_change[r * DERIVED + column];
  }
  for (int r = 0; r < 6 && !failed; r++) {
    memcpy(jacobian + r * 2 * TUBES, total + r * DERIVED, sizeof(double) * 2 * TUBES);
    memcpy(compliance + r * 6, total + r * DERIVED + 2 * TUBES, sizeof(double) * 6);
  }
  for (int r = 0; r < NZ && !failed; r++) memcpy(unknowns + r * 2 * TUBES, change + r * DERIVED, sizeof(double) * 2 * TUBES);
  return failed;
}
