/* From a layout to the columns of numbers that a sweep reads; dimensionless from here on. */

typedef struct {
  Layout *layout;
  Track track;
  double *columns, *shift; /* shift: derivatives of the precurvatures by arc length, where they vary */
  int *flags;
  double free_angles[TUBES], compliance[TUBES], force[3], start[POINT];
  double by_length[TUBES], by_stiffness[TUBES][STIFFNESSES]; /* derivatives of the compliances, SI */
} Case;

static double moment_scale(const Layout *layout) { return layout->stiffness / layout->length; }
static double force_scale(const Layout *layout) { return layout->stiffness / (layout->length * layout->length); }

/* The unit of a stiffness. */
static double stiffness_scale(const Layout *layout, int k) {
  double unit = layout->stiffness;
  for (int power = 0; power < STIFFNESS_LENGTHS[k]; power++) unit *= layout->length;
  return unit;
}

/* The unit of an unknown, and of the tip condition that goes with it. */
static double unit_of(const Layout *layout, int unknown) {
  return unknown < 2 + TUBES ? moment_scale(layout) : force_scale(layout);
}

static void add3(double *to, const double *of, double factor) {
  for (int r = 0; r < 3; r++) to[r] += factor * of[r];
}

/* Whether the components of a load are those in its tube's frame, which turns with the shape. */
static int turning(double frame) {
#if BODY
  return frame != 0.0;
#else
  return 0;
#endif
}

/* A point load into the layout of point data. */
static void add_point(const Layout *layout, const PointLoad *load, double *to) {
  const int tube = 3 * (int)load->tube;
  int force = POINT_FORCE, moment = POINT_MOMENT + tube;
#if BODY
  if (turning(load->frame)) {
    force = POINT_BODY_FORCE + tube;
    moment = POINT_BODY_MOMENT + tube;
  }
#endif
  add3(to + force, load->force, 1.0 / force_scale(layout));
  add3(to + moment, load->moment, 1.0 / moment_scale(layout));
}

static void fill_tubes(Case *c, int k) {
  const Layout *layout = c->layout;
  const Robot *robot = layout->robot;
  const Tableau *rk = c->track.rk;
  const Step step = layout->step[k];
  const double section_middle = 0.5 * (layout->at[step.section].s + layout->at[step.section + 1].s);
  double *column = c->columns + (size_t)k * column_size(rk), *shift = c->shift + (size_t)k * 3 * TUBES * rk->stages;
  double *curved = column + part_start(rk, PART_PRECURVATURE);
  column[0] = (step.end - step.start) / layout->length;
  for (int i = 0; i < TUBES; i++) {
    const int present = section_middle < layout->ends[i];
    for (int n = 0; n < STIFFNESSES; n++)
      if (present || STIFFNESS_EVERYWHERE[n])
        column[1 + DATA_STIFFNESS + n * TUBES + i] = stiffness_of(robot, i)[n] / stiffness_scale(layout, n);
    if (!present) continue;
    const int piece = piece_of(robot, i, section_middle - layout->translations[i]);
    if (robot->degree == 0) {
      double value[3];
      precurvature(robot, i, piece, 0.0, value, NULL);
      for (int j = 0; j < rk->stages; j++)
        for (int r = 0; r < 3; r++) curved[3 * (TUBES * j + i) + r] = value[r] * layout->length;
      continue;
    }
    for (int j = 0; j < rk->stages; j++) {
      const double s = step.start + rk->nodes[j] * (step.end - step.start);
      double *value = curved + 3 * (TUBES * j + i), slope[3];
      precurvature(robot, i, piece, s - layout->translations[i], value, slope);
      for (int r = 0; r < 3; r++) {
        value[r] *= layout->length;
        if (slope[r] != 0.0) c->flags[k] |= VARYING;
        shift[3 * (TUBES * j + i) + r] = slope[r] * layout->length * layout->length;
      }
    }
  }
}

/* A constant load per length; the same at all nodes of the step. */
static void fill_span(Case *c, int k, const SpanLoad *load) {
  const Layout *layout = c->layout;
  const Tableau *rk = c->track.rk;
  const int tube = (int)load->tube;
  double *column = c->columns + (size_t)k * column_size(rk);
  const double force = layout->length / force_scale(layout), moment = layout->length / moment_scale(layout);
  int forces = part_start(rk, PART_FORCE), moments = part_start(rk, PART_MOMENT) + 3 * tube, every = 3;
#if BODY
  if (turning(load->frame)) {
    forces = part_start(rk, PART_BODY_FORCE) + 3 * tube;
    moments = part_start(rk, PART_BODY_MOMENT) + 3 * tube;
    every = 3 * TUBES;
  }
#endif
  c->flags[k] |= DISTRIBUTED;
  for (int j = 0; j < rk->stages; j++) {
    add3(column + forces + every * j, load->force, force);
    add3(column + moments + 3 * TUBES * j, load->moment, moment);
  }
}

static const double SOFT = 0.15; /* what is softer, compared with the stiffest tube, makes more of errors */

/* Moments bend and twist what is softest most. */
static void weigh(Case *c) {
  const int size = column_size(c->track.rk);
  double softest = INFINITY;
  for (int k = 0; k < c->track.steps; k++) {
    double bending = 0.0;
    for (int i = 0; i < TUBES; i++) bending += c->columns[(size_t)k * size + 1 + DATA_BENDING_STIFFNESS + i];
    softest = fmin(softest, bending);
  }
  double *weight = c->track.weight;
  for (int r = 0; r < NX; r++) weight[r] = 1.0;
  for (int r = 0; r < 2; r++) weight[AT_BENDING + r] = fmax(1.0, SOFT / softest);
  for (int i = 0; i < TUBES; i++)
    weight[AT_TORSION + i] = fmax(1.0, SOFT * c->layout->stiffness / stiffness_of(c->layout->robot, i)[TORSIONAL_STIFFNESS]);
}

static int pack(Layout *layout, const Tableau *rk, Case *c) {
  const int size = column_size(rk), n = layout->steps;
  *c = (Case){.layout = layout, .track = {.rk = rk, .steps = n}};
  c->columns = take(sizeof(double) * size * n);
  c->flags = take(sizeof(int) * n);
  c->shift = take(sizeof(double) * 3 * TUBES * rk->stages * n);
  if (!c->columns || !c->flags || !c->shift) return NO_MEMORY;
  memset(c->columns, 0, sizeof(double) * size * n);
  memset(c->flags, 0, sizeof(int) * n);
  memset(c->shift, 0, layout->robot->degree ? sizeof(double) * 3 * TUBES * rk->stages * n : 0);
  for (int i = 0; i < PARTS; i++) c->track.start[i] = part_start(rk, i);
  c->track.columns = c->columns;
  c->track.flags = c->flags;
  for (int k = 0; k < n; k++) fill_tubes(c, k);
  for (int span = 0; span < layout->loads->spans; span++)
    for (int k = layout->last[layout->of_span[2 * span]] + 1; k <= layout->last[layout->of_span[2 * span + 1]]; k++)
      fill_span(c, k, layout->loads->span + span);
  for (int p = 0; p < layout->loads->points; p++) {
    const PointLoad *load = layout->loads->point + p;
    const int k = layout->last[layout->of_point[p]];
    add_point(layout, load, k < 0 ? c->start : c->columns + (size_t)(k + 1) * size - POINT);
    if (k >= 0) c->flags[k] |= LOADED;
    if (!turning(load->frame)) add3(c->force, load->force, 1.0 / force_scale(layout));
  }
  const int force = part_start(rk, PART_FORCE);
  for (int k = 0; k < n; k++)
    if (c->flags[k] & DISTRIBUTED)
      for (int j = 0; j < rk->stages; j++) {
        const double *column = c->columns + (size_t)k * size;
        add3(c->force, column + force + 3 * j, column[0] * rk->weights[j]);
      }
  for (int i = 0; i < TUBES; i++) {
    const double behind_entry = -layout->translations[i];
    c->free_angles[i] = layout->rotations[i] + preset_twist(layout->robot, i, behind_entry);
    transmission(&behind_entry, stiffness_of(layout->robot, i), c->compliance + i, c->by_length + i, c->by_stiffness[i]);
    c->compliance[i] *= moment_scale(layout);
    if (!(fabs(c->free_angles[i]) <= LARGEST_ANGLE)) return REFUSED;
  }
  weigh(c);
  return 0;
}

/* A copy of a case with its own columns, in which loads and precurvatures are multiplied. */
static void scale_case(const Case *c, double factor, double *columns, Case *scaled) {
  const int size = column_size(c->track.rk);
  *scaled = *c;
  scaled->columns = columns;
  scaled->track.columns = columns;
  for (int k = 0; k < c->track.steps; k++) {
    const double *from = c->columns + (size_t)k * size;
    double *to = columns + (size_t)k * size;
    for (int r = 0; r < 1 + SHARED; r++) to[r] = from[r];
    for (int r = 1 + SHARED; r < size; r++) to[r] = factor * from[r];
  }
  for (int i = 0; i < TUBES; i++)
    scaled->free_angles[i] = c->layout->rotations[i] + factor * (c->free_angles[i] - c->layout->rotations[i]);
  for (int r = 0; r < 3; r++) scaled->force[r] = factor * c->force[r];
  for (int r = 0; r < POINT; r++) scaled->start[r] = factor * c->start[r];
}
