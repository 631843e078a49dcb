/* How directions change the data along the robot, and what they do at point loads.

   Within a step three things may change. A stiffness or a load per length changes a datum by a constant. A precurvature
   changes by a table of coefficients, evaluated at every stage. A translation or place moves the ends of the steps of its
   section in proportion: the step becomes longer, and its stages move along the robot. Where the precurvature varies, a
   stage that moves by ds sees u*' ds of it pass by; a tube that moves along with it takes its precurvature with it, so that
   only the difference of both counts.

   At a point load the state jumps by a function that is linear in the load. Its derivative by the load itself is therefore
   the jump by a unit load, and that by the state is applied in two factors, as in sweep.h. */

typedef struct {
  const Lanes *lanes;
  const Lane *lane; /* of the block */
  int step;
  double ends[BLOCK][2], change[DATA * BLOCK], longer[BLOCK];
} Change;

static double section_middle(const Layout *layout, int step) {
  const int section = layout->step[step].section;
  return 0.5 * (layout->at[section].s + layout->at[section + 1].s);
}

static int present(const Layout *layout, int step, int tube) { return section_middle(layout, step) < layout->ends[tube]; }

static int covers(const Layout *layout, int span, int step) {
  const int *ends = layout->of_span + 2 * span;
  return layout->last[ends[0]] < step && step <= layout->last[ends[1]];
}

/* Where a component of a load per length stands among the data, and its unit. */
static int span_datum(const Layout *layout, const Lane *lane, double *unit) {
  const SpanLoad *load = span_load(layout, lane->index);
  const int tube = 3 * (int)load->tube, moment = lane->kind == BY_SPAN_MOMENT;
  *unit = layout->length / (moment ? moment_scale(layout) : force_scale(layout));
#if BODY
  if (turning(load->frame)) return (moment ? DATA_BODY_MOMENT : DATA_BODY_FORCE) + tube + lane->component;
#endif
  return (moment ? DATA_MOMENT + tube : DATA_FORCE) + lane->component;
}

enum { LENGTHENED = 1, CHANGED = 2 };

/* Changes that are the same all along the step; what is changed, also along it. */
static int change_lane(Change *of, int l) {
  const Case *c = of->lanes->c;
  const Layout *layout = c->layout;
  const Lane *lane = of->lane + l;
  double unit;
  switch (lane->kind) {
    case BY_STIFFNESS: {
      const int n = lane->component, datum = DATA_STIFFNESS + n * TUBES + lane->index;
      if (!STIFFNESS_EVERYWHERE[n] && !present(layout, of->step, lane->index)) return 0;
      of->change[datum * BLOCK + l] = 1.0 / stiffness_scale(layout, n);
      return CHANGED;
    }
    case BY_SPAN_FORCE: case BY_SPAN_MOMENT: {
      if (!covers(layout, lane->index, of->step)) return 0;
      const int datum = span_datum(layout, lane, &unit);
      of->change[datum * BLOCK + l] = unit;
      return CHANGED;
    }
    case BY_PRECURVATURE: return present(layout, of->step, lane->component) ? CHANGED : 0;
    case BY_TRANSLATION: case BY_PLACE:
      step_ends(layout, of->step, lane, of->ends[l]);
      of->longer[l] = (of->ends[l][1] - of->ends[l][0]) / layout->length;
      return (of->longer[l] != 0.0 ? LENGTHENED : 0) | (c->flags[of->step] & VARYING ? CHANGED : 0);
    default: return 0;
  }
}

/* The precurvature in a table, at a stage. */
static void change_precurvature(Change *of, int l, double s) {
  const Layout *layout = of->lanes->c->layout;
  const Robot changed = with_table(of->lanes, of->lane[l].index);
  const int i = of->lane[l].component;
  double value[3];
  if (!present(layout, of->step, i)) return;
  const int piece = piece_of(&changed, i, section_middle(layout, of->step) - layout->translations[i]);
  precurvature(&changed, i, piece, s - layout->translations[i], value, NULL);
  for (int r = 0; r < 3; r++) of->change[(DATA_PRECURVATURE + 3 * i + r) * BLOCK + l] = value[r] * layout->length;
}

/* The precurvatures that pass by where the stage or a tube moves. */
static void shift_precurvature(Change *of, int l, const double *shift, double fraction) {
  const Lane *lane = of->lane + l;
  const double *ends = of->ends[l], moved = ends[0] + fraction * (ends[1] - ends[0]);
  for (int i = 0; i < TUBES; i++) {
    const double past = (moved - (lane->kind == BY_TRANSLATION && lane->index == i)) / of->lanes->c->layout->length;
    for (int r = 0; r < 3; r++) of->change[(DATA_PRECURVATURE + 3 * i + r) * BLOCK + l] = past * shift[3 * i + r];
  }
}

static void change_at(void *pointer, int stage) {
  Change *of = pointer;
  const Case *c = of->lanes->c;
  const Tableau *rk = c->track.rk;
  const Step step = c->layout->step[of->step];
  const double *shift = c->shift + ((size_t)of->step * rk->stages + stage) * 3 * TUBES;
  for (int l = 0; l < BLOCK; l++) {
    const int kind = of->lane[l].kind;
    if (kind == BY_PRECURVATURE) change_precurvature(of, l, step.start + rk->nodes[stage] * (step.end - step.start));
    if ((kind == BY_TRANSLATION || kind == BY_PLACE) && c->flags[of->step] & VARYING)
      shift_precurvature(of, l, shift, rk->nodes[stage]);
  }
}

static int last_node(const Tableau *rk) {
  int node = rk->stages - 1;
  while (rk->nodes[node] != 1.0) node--;
  return node;
}

/* What the directions of a block change all along a step. */
static int begin_change(const Lanes *lanes, int b, int step, Change *change) {
  int what = 0;
  change->lanes = lanes;
  change->lane = lanes->lane + b * BLOCK;
  change->step = step;
  memset(change->longer, 0, sizeof change->longer);
  if (lanes->by_data) memset(change->change, 0, sizeof change->change);
  for (int l = 0; l < BLOCK; l++) what |= change_lane(change, l);
  return what;
}

/* A block through a step that was recorded. */
static void carry_block(Lanes *lanes, int b, int step, const double *linear) {
  const Case *c = lanes->c;
  double *along = lanes->along + (size_t)b * NX * BLOCK;
  Change change;
  const int what = begin_change(lanes, b, step, &change);
  if (!what && !lanes->awake[b]) return;
  lanes->awake[b] = 1;
  const Forcing forcing = {change_at, &change, what & CHANGED ? change.change : NULL, change.longer};
  carry(&c->track, linear, c->flags[step], lanes->by_data, what ? &forcing : NULL, along, BLOCK);
}

/* What a change of the load itself does to the state behind it, which is linear in it. */
static void change_load(const Lanes *lanes, const Lane *lane, const double *x, double *along) {
  const Layout *layout = lanes->c->layout;
  const PointLoad *load = point_load(layout, lane->index);
  PointLoad one = {.tube = load->tube, .frame = load->frame};
  double unit[POINT] = {0}, plain[NX];
  (lane->kind == BY_FORCE ? one.force : one.moment)[lane->component] = 1.0;
  add_point(layout, &one, unit);
  behind(x, unit, plain);
  for (int r = 0; r < NX; r++) along[r * BLOCK] += plain[r] - x[r];
}

/* The tube on whose end a point load rides, or FIXED. */
static int rider(const PointLoad *load) { return isnan(load->s) ? (int)load->tube : FIXED; }

enum { ALL = -2 };

/* State and directions behind the point loads of a break point: ALL, or those that ride on a tube's end, or FIXED. */
static void jump_lanes(Lanes *lanes, int at, int rides, const double *point, double *x) {
  double inner[BEHIND_INNER], outer[BEHIND_OUTER], y[NX];
  behind_slopes(x, point, inner, outer);
  for (int b = 0; b < lanes->blocks; b++) {
    double *along = lanes->along + (size_t)b * NX * BLOCK, part[3 * BLOCK], moved[NX * BLOCK];
    if (lanes->awake[b]) {
      apply_turn(inner, along, part, BLOCK);
      apply_behind(outer, along, part, moved, BLOCK);
      memcpy(along, moved, sizeof moved);
    }
    for (int l = 0; l < BLOCK; l++) {
      const Lane *lane = lanes->lane + b * BLOCK + l;
      if ((lane->kind != BY_FORCE && lane->kind != BY_MOMENT) || lanes->c->layout->of_point[lane->index] != at) continue;
      if (rides != ALL && rider(point_load(lanes->c->layout, lane->index)) != rides) continue;
      change_load(lanes, lane, x, along + l);
      lanes->awake[b] = 1;
    }
  }
  behind(x, point, y);
  memcpy(x, y, sizeof y);
}
