/* One sweep that leaves the tip conditions, predictions at probes, and the derivatives of all of them. SI. */

typedef struct {
  double *residual, *slopes; /* NZ; NZ x columns: unknowns, then directions */
  double *poses, *rates;     /* of each probe 3 x 4; 6 x columns: position, and turn of the material frame in the world */
  double *inner, *inner_rates; /* or NULL; of each probe the tube's angle, m_xy, tau: INSIDE; INSIDE x columns */
} Answer;

enum { INSIDE = 3 + TUBES };

/* The material frame of a tube at a state, 3 x 4 with the position. */
static void pose_of(const Layout *layout, const double *x, int tube, double *pose) {
  double frame[9], turn_rows[BEHIND_INNER];
  attitude(x, frame, turn_rows);
  const double c = cos(x[AT_ANGLES + tube]), s = sin(x[AT_ANGLES + tube]);
  for (int r = 0; r < 3; r++) {
    const double *row = frame + 3 * r;
    pose[4 * r] = c * row[0] + s * row[1];
    pose[4 * r + 1] = c * row[1] - s * row[0];
    pose[4 * r + 2] = row[2];
    pose[4 * r + 3] = x[AT_POSITION + r] * layout->length;
  }
}

/* The turn of the frame in the world: R times the body's turn, with that of a tube about the tangent. */
static void pose_rates(const Layout *layout, const double *x, const double *along, int tube, double *out) {
  double part[3 * BLOCK], turn_rows[BEHIND_INNER], frame[9];
  attitude(x, frame, turn_rows);
  apply_turn(turn_rows, along, part, BLOCK);
  for (int k = 0; k < BLOCK; k++) part[2 * BLOCK + k] += along[(AT_ANGLES + tube) * BLOCK + k];
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < BLOCK; k++) {
      out[r * BLOCK + k] = along[(AT_POSITION + r) * BLOCK + k] * layout->length;
      out[(3 + r) * BLOCK + k] =
          frame[3 * r] * part[k] + frame[3 * r + 1] * part[BLOCK + k] + frame[3 * r + 2] * part[2 * BLOCK + k];
    }
}

/* Angle, m_xy and tau, or changes of them, out of a state or lanes. */
static void inside(const Layout *layout, const double *x, int tube, const int width, double *out) {
  const double moment = moment_scale(layout);
  for (int k = 0; k < width; k++) out[k] = x[(AT_ANGLES + tube) * width + k];
  for (int r = 0; r < 2 + TUBES; r++) /* tau stands behind m_xy */
    for (int k = 0; k < width; k++) out[(1 + r) * width + k] = x[(AT_BENDING + r) * width + k] * moment;
}

static void scatter(const Lanes *lanes, int b, int rows, const double *from, double *to) {
  for (int l = 0; l < BLOCK; l++) {
    const int column = lanes->lane[b * BLOCK + l].to;
    for (int r = 0; r < rows && column >= 0; r++) to[(size_t)r * lanes->columns + column] = from[r * BLOCK + l];
  }
}

/* By how much more a probe moves along the robot than the break point that stands for it. */
static double slides(const Layout *layout, const Lane *lane, int point) {
  const double s = point_row(layout, point)[LOAD_S];
  const int rides = isnan(s) ? (int)point_row(layout, point)[LOAD_TUBE] : -1, mover = moves(layout, lane);
  const int own = rides >= 0 ? lane->kind == BY_TRANSLATION && lane->index == rides
                             : lane->kind == BY_PLACE && lane->index == point;
  return (double)own - (mover >= 0 && layout->at[layout->of_point[point]].mover == mover);
}

/* The change of the state with arc length, at the end of a step or at the beginning of the first. */
static void state_rate(const Case *c, int step, const double *x, double *rate) {
  const Tableau *rk = c->track.rk;
  const double *data[PARTS];
  const int first = step < 0, k = first ? 0 : step;
  int node = first ? 0 : rk->stages - 1;
  while (!first && rk->nodes[node] != 1.0) node--;
  at_node(&c->track, c->columns + (size_t)k * column_size(rk), node, data);
  double by_parts[INNER], outer[OUTER]; /* not `rates`: the compiler makes it part of `advance`, its only user */
  if (c->flags[k] & DISTRIBUTED) slopes(x, data, rate, by_parts, outer);
  else free_slopes(x, data, rate, by_parts, outer);
}

/* Predictions at a probe: at the end of a step before any load there, or at the entry (step -1). */
static void probe(const Lanes *lanes, int k, int step, const double *x, Answer *answer) {
  const Layout *layout = lanes->c->layout;
  const int point = lanes->asked->probes[2 * k], tube = lanes->asked->probes[2 * k + 1];
  const size_t columns = lanes->columns;
  double rate[NX] = {0}, after[NX], out[(6 + INSIDE) * BLOCK], moved[NX * BLOCK];
  pose_of(layout, x, tube, answer->poses + 12 * (size_t)k);
  if (answer->inner) inside(layout, x, tube, 1, answer->inner + INSIDE * (size_t)k);
  memcpy(after, x, sizeof after);
  if (step < 0) behind(x, lanes->c->start, after);
  state_rate(lanes->c, step, after, rate);
  for (int b = 0; b < lanes->blocks; b++) {
    memcpy(moved, lanes->along + (size_t)b * NX * BLOCK, sizeof moved);
    for (int l = 0; l < BLOCK; l++) {
      const double past = slides(layout, lanes->lane + b * BLOCK + l, point) / layout->length;
      for (int r = 0; r < NX && past != 0.0; r++) moved[r * BLOCK + l] += past * rate[r];
    }
    pose_rates(layout, x, moved, tube, out);
    scatter(lanes, b, 6, out, answer->rates + 6 * columns * k);
    if (!answer->inner_rates) continue;
    inside(layout, moved, tube, BLOCK, out);
    scatter(lanes, b, INSIDE, out, answer->inner_rates + INSIDE * columns * k);
  }
}

static void probe_all(const Lanes *lanes, int step, const double *x, Answer *answer) {
  const Layout *layout = lanes->c->layout;
  for (int k = 0; k < lanes->asked->probe_count; k++)
    if (layout->last[layout->of_point[lanes->asked->probes[2 * k]]] == step) probe(lanes, k, step, x, answer);
}

static int check_probes(const Layout *layout, const Asked *asked) {
  for (int k = 0; k < asked->probe_count; k++) {
    const int point = asked->probes[2 * k], tube = asked->probes[2 * k + 1];
    if (point < 0 || point >= layout->loads->points || tube < 0 || tube >= TUBES) return REFUSED;
    if (layout->at[layout->of_point[point]].s > layout->ends[tube]) return REFUSED;
  }
  return 0;
}

static void tip(const Lanes *lanes, const double *x, Answer *answer) {
  for (int i = 0; i < NZ; i++) {
    const double unit = unit_of(lanes->c->layout, i);
    answer->residual[i] = unit * x[TIP_ROWS[i]];
    for (int b = 0; b < lanes->blocks; b++) {
      double row[BLOCK];
      for (int l = 0; l < BLOCK; l++) row[l] = unit * lanes->along[((size_t)b * NX + TIP_ROWS[i]) * BLOCK + l];
      scatter(lanes, b, 1, row, answer->slopes + (size_t)i * lanes->columns);
    }
  }
}

/* Directions that are not carried along: they move all positions alike. */
static void move_all(const Lanes *lanes, Answer *answer) {
  for (int k = 0; k < lanes->asked->count; k++) {
    const int *row = lanes->asked->directions + 3 * k, column = NZ + k;
    if (carried(row[0])) continue;
    for (int i = 0; i < NZ; i++) answer->slopes[(size_t)i * lanes->columns + column] = 0.0;
    for (int p = 0; p < lanes->asked->probe_count; p++) {
      for (int r = 0; r < 6; r++) answer->rates[(6 * (size_t)p + r) * lanes->columns + column] = r == row[2];
      for (int r = 0; r < INSIDE && answer->inner_rates; r++)
        answer->inner_rates[(INSIDE * (size_t)p + r) * lanes->columns + column] = 0.0;
    }
  }
}

/* Everything at unknowns z, dimensionless. */
static int evaluate(Layout *layout, const double *z, const Asked *asked, Answer *answer) {
  double x[NX], linear[MOST_STAGES * (NX + INNER_BY_DATA + OUTER_BY_DATA)];
  Case c;
  Lanes lanes;
  int failed = pack(layout, &RK8, &c);
  if (!failed) failed = check_probes(layout, asked);
  if (!failed) failed = line_up(&c, z, asked, &lanes);
  if (failed) return failed;
  start_state(&c, z, x);
  start_lanes(&lanes);
  probe_all(&lanes, -1, x, answer);
  jump_lanes(&lanes, 0, c.start, x);
  for (int k = 0; k < c.track.steps; k++) {
    const double *column = c.columns + (size_t)k * column_size(c.track.rk);
    const int section = layout->step[k].section, last = layout->last[section + 1] == k;
    if (lanes.by_data) record(&c.track, column, c.flags[k], 1, x, linear);
    else record(&c.track, column, c.flags[k], 0, x, linear);
    for (int b = 0; b < lanes.blocks; b++) carry_block(&lanes, b, k, linear);
    if (last) probe_all(&lanes, k, x, answer);
    if (last && c.flags[k] & LOADED) jump_lanes(&lanes, section + 1, point_data(c.track.rk, column), x);
  }
  tip(&lanes, x, answer);
  move_all(&lanes, answer);
  return 0;
}

enum { DERIVED = 2 * TUBES + 6 }; /* rotations, translations, force and moment */

/* What a derivative at an equilibrium is in all: dy/dp - dy/dz (dr/dz)^-1 dr/dp, rows of `rows` by `count` parameters. */
static int total_rates(int rows, int count, const double *slopes_, const double *rates_, double *total) {
  const int columns = NZ + count;
  double tip_[NZ * NZ], change[NZ * DERIVED];
  for (int i = 0; i < NZ; i++) {
    memcpy(tip_ + i * NZ, slopes_ + i * columns, sizeof(double) * NZ);
    memcpy(change + i * count, slopes_ + i * columns + NZ, sizeof(double) * count);
  }
  if (solve(NZ, count, tip_, change)) return SINGULAR;
  for (int r = 0; r < rows; r++)
    for (int d = 0; d < count; d++) {
      double sum = rates_[r * columns + NZ + d];
      for (int i = 0; i < NZ; i++) sum -= rates_[r * columns + i] * change[i * count + d];
      total[r * count + d] = sum;
    }
  return 0;
}
