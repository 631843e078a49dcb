/* Directions of change, by unknowns at the entry and by parameters: each is a lane of a block, and blocks are carried along
   the robot side by side. A lane holds derivatives of dimensionless states by one unknown or parameter in SI; units are
   constants.

   A parameter acts in up to three ways: on the state at the entry (seeded here), on the data along the robot and the ends
   of steps, and at point loads (both in forcing.h). At the entry
     psi_i(0) = rotation_i + twist of the preset over the transmission + compliance_i tau_i,
     n(0)     = all dead loads in front, as n vanishes at the tip,
   so that a rotation, a stiffness, a translation (which lengthens the transmission) and a precurvature change psi_i(0), a
   dead force changes n(0), and a translation or place that uncovers more of a load per length does, too. The entry's own
   position moves every position alike and changes nothing else: it is not carried along. */

enum { BY_UNKNOWN = DIRECTIONS, NOTHING }; /* not asked for: unknowns, and lanes to spare */
enum { BLOCK = 8 }; /* lanes side by side */

typedef struct {
  int kind, index, component, to; /* to: column of the results, or -1 */
} Lane;

typedef struct {
  const Case *c;
  const Asked *asked;
  const double *z;
  int blocks, columns, by_data; /* by_data: some change the data along the robot */
  Lane *lane;
  double *along; /* NX x BLOCK of each block */
  int *awake;    /* whether it has a number other than zero */
} Lanes;

static const PointLoad *point_load(const Layout *layout, int k) { return layout->loads->point + k; }
static const SpanLoad *span_load(const Layout *layout, int k) { return layout->loads->span + k; }

static size_t table_size(const Robot *robot) { return (size_t)robot->pieces[TUBES] * (robot->degree + 1) * 3; }

/* The robot with a table of changes in the place of its coefficients. */
static Robot with_table(const Lanes *lanes, int table) {
  Robot changed = *lanes->c->layout->robot;
  changed.coefficients = lanes->asked->tables + table * table_size(&changed);
  return changed;
}

/* The mover of break points that a direction moves, or IDLE. */
static int moves(const Layout *layout, const Lane *lane) {
  if (lane->kind == BY_TRANSLATION) return lane->index;
  if (lane->kind != BY_PLACE) return IDLE;
  return point_mover(point_load(layout, lane->index), lane->index, FIXED);
}

/* Whether a direction names something that is there. */
static int check_direction(const Layout *layout, const Lane *lane) {
  const Loads *loads = layout->loads;
  const int most[DIRECTIONS] = {
      [BY_STIFFNESS] = TUBES, [BY_ROTATION] = TUBES, [BY_TRANSLATION] = TUBES,
      [BY_POSITION] = 1, [BY_TURN] = 1, [BY_FORCE] = loads->points, [BY_MOMENT] = loads->points,
      [BY_PLACE] = loads->points, [BY_SPAN_FORCE] = loads->spans, [BY_SPAN_MOMENT] = loads->spans,
      [BY_PRECURVATURE] = INT32_MAX};
  const int components = lane->kind == BY_PRECURVATURE ? TUBES : lane->kind == BY_STIFFNESS ? STIFFNESSES : 3;
  if (lane->kind < 0 || lane->kind >= DIRECTIONS || lane->index < 0 || lane->index >= most[lane->kind]) return REFUSED;
  if (lane->component < 0 || lane->component >= components) return REFUSED;
  if (lane->kind == BY_PLACE && isnan(point_load(layout, lane->index)->s)) return REFUSED;
  return 0;
}

/* Whether derivatives by a mover have two sides: its break points coincide with others, or pass a probe that stays. The
   model at the coincidence itself has break points advance from a probe, so that only the other side is another. */
static int two_sided(const Layout *layout, const Asked *asked, int mover, int side) {
  if (mover < 0 || layout->tied[mover]) return mover >= 0;
  const int back = side < 0 || (mover < TUBES && layout->translations[mover] >= -layout->same);
  for (int k = 0; k < asked->probe_count && back; k++) {
    const int point = asked->probes[k].point, tube = (int)point_load(layout, point)->tube;
    const int rides = isnan(point_load(layout, point)->s) && tube == mover;
    if (layout->at[layout->of_point[point]].mover == mover && !rides) return 1;
  }
  return 0;
}

static Lane lane_of(const Asked *asked, int k) {
  const Direction *of = asked->directions + k;
  return (Lane){of->kind, of->index, of->component, NZ + k};
}

/* Lanes that change alike stand together: data along the robot, the state at the entry, or nothing before a load. */
static int group_of(int kind) {
  switch (kind) {
    case BY_UNKNOWN: case BY_ROTATION: case BY_TURN: case BY_FORCE: return 0;
    case BY_MOMENT: return 2;
    default: return 1;
  }
}

/* Nothing that is known here depends on the position: it is not carried along. */
static int carried(int kind) { return kind != BY_POSITION; }

/* Whether it changes data along the robot, and not merely where steps end. */
static int changes_data(const Robot *robot, int kind) {
  switch (kind) {
    case BY_STIFFNESS: case BY_SPAN_FORCE: case BY_SPAN_MOMENT: case BY_PRECURVATURE: return 1;
    case BY_TRANSLATION: case BY_PLACE: return robot->degree > 0;
    default: return 0;
  }
}

/* The unknowns, and all directions or, if `only` is a mover, those that move it. A direction that parts break points is
   left out. */
static int line_up(const Case *c, const double *z, const Asked *asked, int only, Lanes *lanes) {
  const int n = NZ + asked->count, most = (n + BLOCK - 1) / BLOCK;
  *lanes = (Lanes){.c = c, .asked = asked, .z = z, .columns = n};
  lanes->lane = take(sizeof(Lane) * BLOCK * most);
  lanes->along = take(sizeof(double) * NX * BLOCK * most);
  lanes->awake = take(sizeof(int) * most);
  if (!lanes->lane || !lanes->along || !lanes->awake) return NO_MEMORY;
  int next = 0;
  for (int group = 0; group < 3; group++)
    for (int k = 0; k < n; k++) {
      const Lane lane = k < NZ ? (Lane){BY_UNKNOWN, k, 0, k} : lane_of(asked, k - NZ);
      if (k >= NZ && check_direction(c->layout, &lane)) return REFUSED;
      const int mover = k < NZ ? IDLE : moves(c->layout, &lane);
      if (k >= NZ && (only == IDLE ? mover >= 0 && c->layout->tied[mover] : mover != only)) continue;
      if (group_of(lane.kind) != group || !carried(lane.kind)) continue;
      lanes->lane[next++] = lane;
      lanes->by_data |= changes_data(c->layout->robot, lane.kind);
    }
  lanes->blocks = (next + BLOCK - 1) / BLOCK;
  while (next < lanes->blocks * BLOCK) lanes->lane[next++] = (Lane){NOTHING, 0, 0, -1};
  return 0;
}

/* How start and end of a step move with a direction, by a metre of it. */
static void step_ends(const Layout *layout, int k, const Lane *lane, double *ends) {
  const Step step = layout->step[k];
  const Break from = layout->at[step.section], to = layout->at[step.section + 1];
  const int mover = moves(layout, lane);
  const double start = mover >= 0 && from.mover == mover, end = mover >= 0 && to.mover == mover;
  ends[0] = start + (step.start - from.s) / (to.s - from.s) * (end - start);
  ends[1] = start + (step.end - from.s) / (to.s - from.s) * (end - start);
}

/* -- at the entry ------------------------------------------------------------------------------------------------------- */

/* The change of n(0) when loads per length cover more or less. */
static void grow_force(const Case *c, const Lane *lane, double *along) {
  const int size = column_size(c->track.rk), force = part_start(c->track.rk, PART_FORCE);
  for (int k = 0; k < c->track.steps; k++) {
    double ends[2];
    if (!(c->flags[k] & DISTRIBUTED)) continue;
    step_ends(c->layout, k, lane, ends);
    for (int r = 0; r < 3; r++) /* constant along the step */
      along[(AT_FORCE + r) * BLOCK] += (ends[1] - ends[0]) / c->layout->length * c->columns[(size_t)k * size + force + r];
  }
}

static void seed_translation(const Case *c, const Lane *lane, const double *z, double *along) {
  const Robot *robot = c->layout->robot;
  const int i = lane->index;
  const double sigma = -c->layout->translations[i];
  double preset[3];
  precurvature(robot, i, piece_of(robot, i, sigma), sigma, preset, NULL);
  along[(AT_ANGLES + i) * BLOCK] = -c->by_length[i] * z[2 + i] * moment_scale(c->layout) - preset[2];
  grow_force(c, lane, along);
}

/* dR = R hat(e): half the quaternion product with the axis. */
static void seed_turn(const Case *c, int axis, double *along) {
  const double *q = c->layout->robot->orientation;
  const int next = (axis + 1) % 3, other = (axis + 2) % 3;
  along[AT_ORIENTATION * BLOCK] = -0.5 * q[1 + axis];
  along[(AT_ORIENTATION + 1 + axis) * BLOCK] = 0.5 * q[0];
  along[(AT_ORIENTATION + 1 + next) * BLOCK] = 0.5 * q[1 + other];
  along[(AT_ORIENTATION + 1 + other) * BLOCK] = -0.5 * q[1 + next];
}

static void seed_span(const Case *c, const Lane *lane, double *along) {
  const Layout *layout = c->layout;
  const int *ends = layout->of_span + 2 * lane->index;
  if (turning(span_load(layout, lane->index)->frame)) return;
  along[(AT_FORCE + lane->component) * BLOCK] = (layout->at[ends[1]].s - layout->at[ends[0]].s) / force_scale(layout);
}

static void seed(const Lanes *lanes, const Lane *lane, double *along) {
  const Case *c = lanes->c;
  const Layout *layout = c->layout;
  const int i = lane->index;
  switch (lane->kind) {
    case BY_UNKNOWN: start_unknown(c, i, 1.0 / unit_of(layout, i), along, BLOCK); break;
    case BY_STIFFNESS:
      along[(AT_ANGLES + i) * BLOCK] = c->by_stiffness[i][lane->component] * lanes->z[2 + i] * moment_scale(layout);
      break;
    case BY_ROTATION: along[(AT_ANGLES + i) * BLOCK] = 1.0; break;
    case BY_TRANSLATION: seed_translation(c, lane, lanes->z, along); break;
    case BY_PLACE: grow_force(c, lane, along); break;
    case BY_TURN: seed_turn(c, lane->component, along); break;
    case BY_FORCE:
      if (!turning(point_load(layout, i)->frame))
        along[(AT_FORCE + lane->component) * BLOCK] = 1.0 / force_scale(layout);
      break;
    case BY_SPAN_FORCE: seed_span(c, lane, along); break;
    case BY_PRECURVATURE: {
      const Robot changed = with_table(lanes, i);
      along[(AT_ANGLES + lane->component) * BLOCK] =
          preset_twist(&changed, lane->component, -layout->translations[lane->component]);
      break;
    }
    default: break;
  }
}

/* The directions at the entry. */
static void start_lanes(Lanes *lanes) {
  memset(lanes->along, 0, sizeof(double) * NX * BLOCK * lanes->blocks);
  for (int b = 0; b < lanes->blocks; b++) {
    double *along = lanes->along + (size_t)b * NX * BLOCK;
    for (int l = 0; l < BLOCK; l++) seed(lanes, lanes->lane + b * BLOCK + l, along + l);
    lanes->awake[b] = largest(NX * BLOCK, along) != 0.0;
  }
}
