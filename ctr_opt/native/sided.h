/* Derivatives by directions that part break points which coincide: one for each side.

   The shape is continuous in everything, but where a direction moves a break point past another, its derivative jumps. The
   derivative from one side is that of the robot right beside, on that side: the mover alone is shifted by half of the
   distance within which points are one, and points are then one within a quarter of it. So its break points lie apart from
   those that they coincide with, in the order that they take there, and pass none that lay apart before. The derivative is
   then off by its own change over that distance, far below the error of a solve. The unknowns are not solved for again,
   which changes as little. */

static const double LEAST_APART = 0.5, MOST_APART = 1e4, SAME_BESIDE = 0.25; /* of SAME_POINT */

/* What is laid out. The point load number `tip`, if it is not negative, rides on the tube that ends at the tip. */
typedef struct {
  const Robot *robot;
  Loads loads;
  double actuation[2 * TUBES];
  int refinements, tip;
  double same, beyond; /* as for lay_out_within */
} Setting;

/* Halve the steps of a layout as many times as the solve halved them. */
static int halve_again(int refinements, Layout *layout) {
  Layout finer;
  int failed = 0;
  for (int k = 0; k < refinements && !failed; k++) {
    failed = halve(layout, &finer);
    *layout = finer;
  }
  return failed;
}

/* The layout of a result. */
static int again(const Robot *robot, const Loads *loads, const double *actuation, int refinements, Layout *layout) {
  const int failed = lay_out(robot, loads, actuation, layout);
  return failed ? failed : halve_again(refinements, layout);
}

static double end_of(const Robot *robot, const double *translations, int tube) {
  return translations[tube] + robot->breaks[robot->pieces[tube + 1] + tube];
}

static int innermost_at_tip(const Robot *robot, const double *translations, double same) {
  double ends[TUBES], length = 0.0;
  for (int i = 0; i < TUBES; i++) {
    ends[i] = end_of(robot, translations, i);
    length = fmax(length, ends[i]);
  }
  chain(same * SAME_POINT * length, ends);
  int tube = 0;
  while (ends[tube] < length) tube++;
  return tube;
}

/* Loads of its own for a setting, to be changed. */
static int own_loads(Setting *setting, PointLoad **points, SpanLoad **spans) {
  const Loads *loads = &setting->loads;
  *points = take(sizeof(PointLoad) * (loads->points + 1));
  *spans = take(sizeof(SpanLoad) * (loads->spans + 1));
  if (!*points || !*spans) return NO_MEMORY;
  if (loads->points) memcpy(*points, loads->point, sizeof(PointLoad) * loads->points);
  if (loads->spans) memcpy(*spans, loads->span, sizeof(SpanLoad) * loads->spans);
  setting->loads.point = *points;
  setting->loads.span = *spans;
  return 0;
}

/* Lay a setting out; `layout` refers to it. */
static int set_up(Setting *setting, Layout *layout) {
  PointLoad *points;
  SpanLoad *spans;
  if (setting->tip >= 0) {
    if (own_loads(setting, &points, &spans)) return NO_MEMORY;
    points[setting->tip].tube = innermost_at_tip(setting->robot, setting->actuation + TUBES, setting->same);
  }
  const double same = setting->same, beyond = setting->beyond;
  const int failed = lay_out_within(setting->robot, &setting->loads, setting->actuation, same, beyond, layout);
  return failed ? failed : halve_again(setting->refinements, layout);
}

/* Shift a mover to one side. A base at the entry point can only be drawn back. A load at the end of its tube stays on it if
   its own place is shifted. If the tube is drawn back, the load stays where it is, or on the tube if that is the longest. */
static int shift(Setting *setting, int mover, double slack, double by) {
  PointLoad *points;
  SpanLoad *spans;
  double *translations = setting->actuation + TUBES, length = 0.0;
  if (own_loads(setting, &points, &spans)) return NO_MEMORY;
  if (mover >= TUBES) {
    PointLoad *load = points + (mover - TUBES);
    load->s += load->s + by > end_of(setting->robot, translations, (int)load->tube) ? -fabs(by) : by;
    return 0;
  }
  if (translations[mover] >= -slack) by = -fabs(by);
  translations[mover] += by;
  if (!(translations[mover] <= 0.0)) return REFUSED;
  for (int i = 0; i < TUBES; i++) length = fmax(length, end_of(setting->robot, translations, i));
  length += SAME_BESIDE * slack;
  for (int k = 0; k < setting->loads.points; k++) /* not those that ride: comparisons with NaN are false */
    if (k != setting->tip && points[k].s > length) points[k].s += 2.0 * by;
  for (int k = 0; k < 2 * setting->loads.spans; k++)
    if (spans[k / 2].ends[k % 2] > length) spans[k / 2].ends[k % 2] += 2.0 * by;
  return 0;
}

/* The setting with a mover on one side of the break points with which it coincides. */
static int set_apart(const Setting *setting, double length, int mover, int side, Setting *beside, Layout *layout) {
  for (double apart = LEAST_APART; apart <= MOST_APART; apart *= 2.0) {
    *beside = *setting;
    beside->same = SAME_BESIDE;
    beside->beyond = 2.0 + 2.0 * apart;
    int failed = shift(beside, mover, SAME_POINT * length, side * apart * SAME_POINT * length);
    if (!failed) failed = set_up(beside, layout);
    if (failed || !layout->tied[mover]) return failed;
  }
  return REFUSED;
}

static int evaluate_si(Layout *layout, const double *z, const Asked *asked, int only, Answer *answer) {
  double scaled[NZ];
  for (int i = 0; i < NZ; i++) scaled[i] = z[i] / unit_of(layout, i);
  return evaluate(layout, scaled, asked, only, answer);
}

/* The mover of a direction with two derivatives, if no direction before has it; IDLE otherwise. */
static int new_mover(const Layout *layout, const Asked *asked, int side, int k) {
  const Lane lane = lane_of(asked, k);
  if (!two_sided(layout, asked, moves(layout, &lane), side)) return IDLE;
  for (int j = 0; j < k; j++) {
    const Lane before = lane_of(asked, j);
    if (moves(layout, &before) == moves(layout, &lane)) return IDLE;
  }
  return moves(layout, &lane);
}

/* The columns of directions that move a mover, from another answer's matrix of `rows`. */
static void copy_columns(const Layout *layout, const Asked *asked, int mover, size_t rows, const double *from, double *to) {
  const int columns = NZ + asked->count;
  for (int k = 0; k < asked->count && from; k++) {
    const Lane lane = lane_of(asked, k);
    if (moves(layout, &lane) != mover) continue;
    for (size_t r = 0; r < rows; r++) to[r * columns + NZ + k] = from[r * columns + NZ + k];
  }
}

/* Room for an answer like another one. */
static int like(const Answer *answer, const Asked *asked, Answer *room) {
  const size_t columns = NZ + asked->count, probes = asked->probe_count;
  double *next = take(sizeof(double) * (NZ + TUBES + 6 + 15 * probes + columns * (NZ + 9 * probes + TUBES + 6)));
  if (!next) return NO_MEMORY;
  memset(room, 0, sizeof *room);
#define ROOM_FOR(name, size) \
  if (answer->name) { room->name = next; next += (size); }
  ROOM_FOR(residual, NZ)
  ROOM_FOR(slopes, NZ * columns)
  ROOM_FOR(poses, 12 * probes)
  ROOM_FOR(rates, 6 * probes * columns)
  ROOM_FOR(curvatures, 3 * probes)
  ROOM_FOR(curvature_rates, 3 * probes * columns)
  ROOM_FOR(forces, TUBES)
  ROOM_FOR(force_rates, TUBES * columns)
  ROOM_FOR(wrench, 6)
  ROOM_FOR(wrench_rates, 6 * columns)
#undef ROOM_FOR
  return 0;
}

/* Everything at unknowns z, SI, with derivatives from one side where there are two. */
static int evaluate_sided(Setting *setting, const double *z, const Asked *asked, int side, Answer *answer) {
  Layout layout, there;
  Setting beside;
  Answer other;
  int failed = set_up(setting, &layout);
  if (!failed) failed = evaluate_si(&layout, z, asked, IDLE, answer);
  for (int k = 0; k < asked->count && !failed; k++) {
    const int mover = new_mover(&layout, asked, side, k);
    if (mover == IDLE) continue;
    failed = set_apart(setting, layout.length, mover, side, &beside, &there);
    if (!failed) failed = like(answer, asked, &other);
    if (!failed) failed = evaluate_si(&there, z, asked, mover, &other);
    if (failed) break;
    const size_t probes = asked->probe_count;
    copy_columns(&layout, asked, mover, NZ, other.slopes, answer->slopes);
    copy_columns(&layout, asked, mover, 6 * probes, other.rates, answer->rates);
    copy_columns(&layout, asked, mover, 3 * probes, other.curvature_rates, answer->curvature_rates);
    copy_columns(&layout, asked, mover, TUBES, other.force_rates, answer->force_rates);
    copy_columns(&layout, asked, mover, 6, other.wrench_rates, answer->wrench_rates);
  }
  return failed;
}

/* -- derivatives of a pose at an equilibrium ---------------------------------------------------------------------------- */

enum { DERIVED = 2 * TUBES + 6 }; /* rotations, translations, force and moment */

/* What derivatives at an equilibrium are in all: of the unknowns, dz/dp = -(dr/dz)^-1 dr/dp, and of `rows` others,
   dy/dp + dy/dz dz/dp; by `count` parameters. */
static int total_rates(int rows, int count, const double *slopes_, const double *rates_, double *unknowns, double *total) {
  const int columns = NZ + count;
  double tip_[NZ * NZ];
  for (int i = 0; i < NZ; i++) {
    memcpy(tip_ + i * NZ, slopes_ + i * columns, sizeof(double) * NZ);
    for (int d = 0; d < count; d++) unknowns[i * count + d] = -slopes_[i * columns + NZ + d];
  }
  if (solve(NZ, count, tip_, unknowns)) return SINGULAR;
  for (int r = 0; r < rows; r++)
    for (int d = 0; d < count; d++) {
      double sum = rates_[r * columns + NZ + d];
      for (int i = 0; i < NZ; i++) sum += rates_[r * columns + i] * unknowns[i * count + d];
      total[r * count + d] = sum;
    }
  return 0;
}

/* Derivatives of the unknowns (NZ x DERIVED) and of the pose at the only probe (6 x DERIVED): all, or those by a mover. */
static int pose_derivatives(Layout *layout, const double *z, const Asked *asked, int only, double *unknowns, double *total) {
  enum { COLUMNS = NZ + DERIVED };
  double residual[NZ], slopes_[NZ * COLUMNS] = {0}, pose[12], rates_[6 * COLUMNS] = {0};
  Answer answer = {.residual = residual, .slopes = slopes_, .poses = pose, .rates = rates_};
  const int failed = evaluate_si(layout, z, asked, only, &answer);
  return failed ? failed : total_rates(6, DERIVED, slopes_, rates_, unknowns, total);
}
