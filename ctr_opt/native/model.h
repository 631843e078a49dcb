/* One sweep that leaves the tip conditions, predictions at probes, and the derivatives of all of them. SI.

   The unknowns need not be those of an equilibrium: estimates treat them as unknowns of their own, with the tip conditions
   as equations. States and all directions are carried from the entry to the tip once. At a break point, in this order: poses
   are read (the state is continuous but for moments), curvatures of tubes that end there from within them, loads jump, and
   curvatures of the tubes that go on.

   A pose is that of the backbone frame R turned by the tube's angle about the tangent; its rate in the world is
   R (phi + dpsi e3). A probe at a fixed place does not move with its break point, one that rides on a tube's end does: where
   a direction moves the probe by more than the break point that stands for it, the state changes by its slope times the
   difference. Curvature is the turn that the state's own rate makes, so its change is that of the rate: the same products as
   in a step, at the data of that place.

   At an equilibrium dr = 0 = (dr/dz) dz + dr/dp, so that what depends on z and p changes with p by
   dy/dp - dy/dz (dr/dz)^-1 dr/dp in all: `total_rates`. */

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

enum { INNERMOST = -1 };

/* The tube in whose frame a probe is seen: its own, or the innermost one there. */
static int frame_of(const Layout *layout, Probe of) {
  int tube = of.tube;
  const double s = layout->at[layout->of_point[of.point]].s;
  if (tube == INNERMOST)
    for (tube = 0; layout->ends[tube] < s;) tube++;
  return tube;
}

static void scatter(const Lanes *lanes, int b, int rows, const double *from, double *to) {
  for (int l = 0; l < BLOCK; l++) {
    const int column = lanes->lane[b * BLOCK + l].to;
    for (int r = 0; r < rows && column >= 0; r++) to[(size_t)r * lanes->columns + column] = from[r * BLOCK + l];
  }
}

/* Force and moment on the support: the internal loads of the state at the entry, before any load there. The moment m of
   the frame R is R m in the world, and R turns by the rates w in its own axes: d(R m) = R (w x m + dm). */
static void support(const Lanes *lanes, const double *x, Answer *answer) {
  const double force = force_scale(lanes->c->layout), unit = moment_scale(lanes->c->layout);
  double frame[9], turn_rows[BEHIND_INNER], m[3] = {x[AT_BENDING], x[AT_BENDING + 1], 0.0};
  attitude(x, frame, turn_rows);
  for (int i = 0; i < TUBES; i++) m[2] += x[AT_TORSION + i];
  for (int r = 0; r < 3; r++) {
    answer->wrench[r] = x[AT_FORCE + r] * force;
    answer->wrench[3 + r] = (frame[3 * r] * m[0] + frame[3 * r + 1] * m[1] + frame[3 * r + 2] * m[2]) * unit;
  }
  for (int b = 0; b < lanes->blocks; b++) {
    const double *along = lanes->along + (size_t)b * NX * BLOCK;
    double w[3 * BLOCK], out[6 * BLOCK];
    apply_turn(turn_rows, along, w, BLOCK);
    for (int l = 0; l < BLOCK; l++) {
      double d[3] = {along[AT_BENDING * BLOCK + l], along[(AT_BENDING + 1) * BLOCK + l], 0.0};
      for (int i = 0; i < TUBES; i++) d[2] += along[(AT_TORSION + i) * BLOCK + l];
      d[0] += w[BLOCK + l] * m[2] - w[2 * BLOCK + l] * m[1];
      d[1] += w[2 * BLOCK + l] * m[0] - w[l] * m[2];
      d[2] += w[l] * m[1] - w[BLOCK + l] * m[0];
      for (int r = 0; r < 3; r++) {
        out[r * BLOCK + l] = along[(AT_FORCE + r) * BLOCK + l] * force;
        out[(3 + r) * BLOCK + l] = (frame[3 * r] * d[0] + frame[3 * r + 1] * d[1] + frame[3 * r + 2] * d[2]) * unit;
      }
    }
    scatter(lanes, b, 6, out, answer->wrench_rates);
  }
}

/* By how much more a probe moves along the robot than the break point that stands for it. */
static double slides(const Layout *layout, const Lane *lane, int point) {
  const int rides = rider(point_load(layout, point)), mover = moves(layout, lane);
  const int slid = rides >= 0 && lane->kind == BY_TRANSLATION && lane->index == rides;
  return (double)slid - (mover >= 0 && layout->at[layout->of_point[point]].mover == mover);
}

/* At a node of a step: the change of the state with arc length, and the nonzeros of its derivatives by parts. */
static void equations_at(const Case *c, int step, int node, const double *x, double *rate, double *by_parts,
                         double *outer) {
  const double *data[PARTS];
  at_node(&c->track, c->columns + (size_t)step * column_size(c->track.rk), node, data);
  if (c->flags[step] & DISTRIBUTED) slopes_by_data(x, data, rate, by_parts, outer);
  else free_slopes_by_data(x, data, rate, by_parts, outer);
}

/* The directions of a block at a probe that may move along the robot. */
static void slide(const Lanes *lanes, int b, int point, const double *rate, double *moved) {
  const Layout *layout = lanes->c->layout;
  memcpy(moved, lanes->along + (size_t)b * NX * BLOCK, sizeof(double) * NX * BLOCK);
  for (int l = 0; l < BLOCK; l++) {
    const double past = slides(layout, lanes->lane + b * BLOCK + l, point) / layout->length;
    for (int r = 0; r < NX && past != 0.0; r++) moved[r * BLOCK + l] += past * rate[r];
  }
}

/* The pose at a probe: at the end of a step before any load there, or at the entry (step -1). */
static void probe(const Lanes *lanes, int k, int step, const double *x, Answer *answer) {
  const Case *c = lanes->c;
  const Layout *layout = c->layout;
  const int point = lanes->asked->probes[k].point, tube = frame_of(layout, lanes->asked->probes[k]);
  double rate[NX], by_parts[INNER_BY_DATA], outer[OUTER_BY_DATA], after[NX], out[6 * BLOCK], moved[NX * BLOCK];
  pose_of(layout, x, tube, answer->poses + 12 * (size_t)k);
  memcpy(after, x, sizeof after);
  if (step < 0) behind(x, c->start, after);
  equations_at(c, step < 0 ? 0 : step, step < 0 ? 0 : last_node(c->track.rk), after, rate, by_parts, outer);
  for (int b = 0; b < lanes->blocks; b++) {
    slide(lanes, b, point, rate, moved);
    pose_rates(layout, x, moved, tube, out);
    scatter(lanes, b, 6, out, answer->rates + 6 * (size_t)lanes->columns * k);
  }
}

static void probe_all(const Lanes *lanes, int step, const double *x, Answer *answer) {
  const Layout *layout = lanes->c->layout;
  for (int k = 0; k < lanes->asked->probe_count; k++)
    if (layout->last[layout->of_point[lanes->asked->probes[k].point]] == step) probe(lanes, k, step, x, answer);
}

/* The precurvatures that a probe passes by as it moves along the robot. */
static void pass_by(const Lanes *lanes, int b, int point, const double *shift, double *change) {
  const Layout *layout = lanes->c->layout;
  for (int l = 0; l < BLOCK; l++) {
    const double past = slides(layout, lanes->lane + b * BLOCK + l, point) / layout->length;
    for (int r = 0; r < 3 * TUBES && past != 0.0; r++) change[(DATA_PRECURVATURE + r) * BLOCK + l] += past * shift[r];
  }
}

/* The curvature at a probe, at a node of a step: that of the backbone turned into the tube's frame, and the tube's twist. */
static void bend(const Lanes *lanes, int k, int step, int node, const double *x, Answer *answer) {
  const Case *c = lanes->c;
  const Layout *layout = c->layout;
  const int point = lanes->asked->probes[k].point, tube = frame_of(layout, lanes->asked->probes[k]);
  const double *shift = c->shift + ((size_t)step * c->track.rk->stages + node) * 3 * TUBES, unit = 1.0 / layout->length;
  const double along_x = cos(x[AT_ANGLES + tube]), along_y = sin(x[AT_ANGLES + tube]);
  double rate[NX], by_parts[INNER_BY_DATA], outer[OUTER_BY_DATA], frame[9], turn_rows[BEHIND_INNER], u[3];
  equations_at(c, step, node, x, rate, by_parts, outer);
  attitude(x, frame, turn_rows);
  apply_turn(turn_rows, rate, u, 1);
  const double bent[3] = {along_x * u[0] + along_y * u[1], along_x * u[1] - along_y * u[0], rate[AT_ANGLES + tube]};
  for (int r = 0; r < 3; r++) answer->curvatures[3 * (size_t)k + r] = bent[r] * unit;
  for (int b = 0; b < lanes->blocks; b++) {
    Change change;
    double moved[NX * BLOCK], part[5 * BLOCK], turned[NX * BLOCK], out[3 * BLOCK];
    slide(lanes, b, point, rate, moved);
    if (begin_change(lanes, b, step, &change) & CHANGED) {
      change_at(&change, node);
      if (c->flags[step] & VARYING) pass_by(lanes, b, point, shift, change.change);
      apply_by_parts_and_data(by_parts, moved, change.change, part, BLOCK);
      apply_slopes_and_tubes(outer, moved, part, change.change, turned, BLOCK);
    } else {
      apply_by_parts(by_parts, moved, part, BLOCK);
      apply_slopes(outer, moved, part, turned, BLOCK);
    }
    const double *x_change = part + 3 * BLOCK, *y_change = part + 4 * BLOCK;
    const double *turn = moved + (AT_ANGLES + tube) * BLOCK, *twist = turned + (AT_ANGLES + tube) * BLOCK;
    for (int l = 0; l < BLOCK; l++) {
      out[l] = (along_x * x_change[l] + along_y * y_change[l] + bent[1] * turn[l]) * unit;
      out[BLOCK + l] = (along_x * y_change[l] - along_y * x_change[l] - bent[0] * turn[l]) * unit;
      out[2 * BLOCK + l] = twist[l] * unit;
    }
    scatter(lanes, b, 3, out, answer->curvature_rates + 3 * (size_t)lanes->columns * k);
  }
}

/* Curvatures at a break point: of tubes that end there before any load, of others behind it. */
static void bend_all(const Lanes *lanes, int at, int ended, const double *x, Answer *answer) {
  const Layout *layout = lanes->c->layout;
  const int before = layout->last[at];
  for (int k = 0; k < lanes->asked->probe_count && answer->curvatures; k++) {
    const Probe of = lanes->asked->probes[k];
    if (layout->of_point[of.point] != at || (at > 0 && layout->at[at].s >= layout->ends[frame_of(layout, of)]) != ended) continue;
    if (ended) bend(lanes, k, before, last_node(lanes->c->track.rk), x, answer);
    else bend(lanes, k, before + 1, 0, x, answer);
  }
}

static int check_probes(const Layout *layout, const Asked *asked) {
  for (int k = 0; k < asked->probe_count; k++) {
    const int point = asked->probes[k].point, tube = asked->probes[k].tube;
    if (point < 0 || point >= layout->loads->points || tube < INNERMOST || tube >= TUBES) return REFUSED;
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
    const Direction *of = lanes->asked->directions + k;
    const int column = NZ + k;
    if (carried(of->kind)) continue;
    for (int i = 0; i < NZ; i++) answer->slopes[(size_t)i * lanes->columns + column] = 0.0;
    for (int r = 0; r < 6 && answer->wrench_rates; r++) answer->wrench_rates[(size_t)r * lanes->columns + column] = 0.0;
    for (int p = 0; p < lanes->asked->probe_count; p++) {
      for (int r = 0; r < 6; r++) answer->rates[(6 * (size_t)p + r) * lanes->columns + column] = r == of->component;
      for (int r = 0; r < 3 && answer->curvature_rates; r++)
        answer->curvature_rates[(3 * (size_t)p + r) * lanes->columns + column] = 0.0;
    }
  }
}

/* Everything at unknowns z, dimensionless; by directions as for `line_up`. */
static int evaluate(Layout *layout, const double *z, const Asked *asked, int only, Answer *answer) {
  double x[NX], linear[MOST_STAGES * (NX + INNER_BY_DATA + OUTER_BY_DATA)];
  Case c;
  Lanes lanes;
  int failed = pack(layout, &RK8, &c);
  if (!failed) failed = check_probes(layout, asked);
  if (!failed) failed = line_up(&c, z, asked, only, &lanes);
  if (failed) return failed;
  start_state(&c, z, x);
  start_lanes(&lanes);
  probe_all(&lanes, -1, x, answer);
  if (answer->forces) start_forces(&lanes, answer);
  if (answer->wrench) support(&lanes, x, answer);
  jump_lanes(&lanes, 0, ALL, c.start, x);
  bend_all(&lanes, 0, 0, x, answer);
  for (int k = 0; k < c.track.steps; k++) {
    const double *column = c.columns + (size_t)k * column_size(c.track.rk);
    const int section = layout->step[k].section, last = layout->last[section + 1] == k;
    if (lanes.by_data) record(&c.track, column, c.flags[k], 1, x, linear);
    else record(&c.track, column, c.flags[k], 0, x, linear);
    for (int b = 0; b < lanes.blocks; b++) carry_block(&lanes, b, k, linear);
    if (!last) continue;
    probe_all(&lanes, k, x, answer);
    bend_all(&lanes, section + 1, 1, x, answer);
    if (answer->forces && cross(&lanes, section + 1, x, answer)) return NO_MEMORY;
    if (!answer->forces && c.flags[k] & LOADED) jump_lanes(&lanes, section + 1, ALL, point_data(c.track.rk, column), x);
    bend_all(&lanes, section + 1, 0, x, answer);
  }
  tip(&lanes, x, answer);
  move_all(&lanes, answer);
  return 0;
}
