/* The boundary-value problem: unknown moments (and force) at the entry, conditions at the tip. */

/* Directions of change at the entry, in this order; the first NZ are those of the unknowns. */
enum {
  ALONG_BENDING = 0,
  ALONG_TORSION = 2,
  ALONG_FORCE_UNKNOWN = 2 + TUBES, /* under live loads only */
  ALONG_ANGLE = NZ,                /* of the tubes, psi(0) */
  ALONG_FORCE = NZ + TUBES,        /* at the tip, world */
  ALONG_TRANSLATION = ALONG_FORCE + 3,
  EVERY = ALONG_TRANSLATION + TUBES,
};
#define PADDED(width) (((width) + 3) / 4 * 4)

static void start_state(const Case *c, const double *z, double *x) {
  const Robot *robot = c->layout->robot;
  for (int r = 0; r < 3; r++) x[AT_POSITION + r] = robot->position[r] / c->layout->length;
  memcpy(x + AT_ORIENTATION, robot->orientation, sizeof(double) * 4);
  for (int i = 0; i < TUBES; i++) x[AT_ANGLES + i] = c->free_angles[i] + c->compliance[i] * z[2 + i];
  memcpy(x + AT_BENDING, z, sizeof(double) * 2);
  memcpy(x + AT_TORSION, z + 2, sizeof(double) * TUBES);
  for (int r = 0; r < 3; r++) x[AT_FORCE + r] = c->force[r] + (LIVE ? z[2 + TUBES + r] : 0.0);
}

/* How the state at the entry changes along the first `wanted` directions: those of the unknowns, or all. */
INLINE void start_along(const Case *c, const double *z, double *along, const int width, const int wanted) {
  memset(along, 0, sizeof(double) * NX * width);
  for (int r = 0; r < 2; r++) along[(AT_BENDING + r) * width + ALONG_BENDING + r] = 1.0;
  for (int i = 0; i < TUBES; i++) {
    along[(AT_TORSION + i) * width + ALONG_TORSION + i] = 1.0;
    along[(AT_ANGLES + i) * width + ALONG_TORSION + i] = c->compliance[i];
  }
  if (LIVE)
    for (int r = 0; r < 3; r++) along[(AT_FORCE + r) * width + ALONG_FORCE_UNKNOWN + r] = 1.0;
  if (wanted <= NZ) return;
  for (int i = 0; i < TUBES; i++) along[(AT_ANGLES + i) * width + ALONG_ANGLE + i] = 1.0;
  for (int r = 0; r < 3; r++) along[(AT_FORCE + r) * width + ALONG_FORCE + r] = 1.0;
  const Layout *layout = c->layout;
  for (int i = 0; i < TUBES; i++) { /* a translation by the unit of length */
    double preset[3];
    const double sigma = -layout->translations[i];
    precurvature(layout->robot, i, piece_of(layout->robot, i, sigma), sigma, preset, NULL);
    const double compliance = layout->length / layout->robot->torsional[i] * moment_scale(layout);
    along[(AT_ANGLES + i) * width + ALONG_TRANSLATION + i] = -compliance * z[2 + i] - preset[2] * layout->length;
  }
}

/* How start and end of a step move with each translation by the unit of length. */
static void step_ends(const Layout *layout, int k, double *ends) {
  const Step step = layout->step[k];
  const Break from = layout->at[step.section], to = layout->at[step.section + 1];
  const double a = (step.start - from.s) / (to.s - from.s), b = (step.end - from.s) / (to.s - from.s);
  for (int i = 0; i < TUBES; i++) {
    const double start = from.mover == i, end = to.mover == i;
    ends[i] = start + a * (end - start);
    ends[TUBES + i] = start + b * (end - start);
  }
}

/* The change of n(0) with translations: loads per length cover more or less. */
static void force_along(const Case *c, double *along, const int width) {
  const Tableau *rk = c->track.rk;
  const int size = column_size(rk), force = part_start(rk, PART_FORCE);
  for (int k = 0; k < c->track.steps; k++) {
    if (!(c->flags[k] & DISTRIBUTED)) continue;
    double ends[2 * TUBES];
    step_ends(c->layout, k, ends);
    const double *column = c->columns + (size_t)k * size;
    for (int j = 0; j < rk->stages; j++)
      for (int i = 0; i < TUBES; i++) {
        const double longer = ends[TUBES + i] - ends[i];
        for (int r = 0; r < 3; r++)
          along[(AT_FORCE + r) * width + ALONG_TRANSLATION + i] += rk->weights[j] * longer * column[force + 3 * j + r];
      }
  }
}

/* What a sweep with directions leaves: state and directions at the tip, positions' at the nodes if wanted. */
typedef struct {
  double x[NX];
  double *along;     /* NX x width at the tip */
  double *positions; /* 3 x NZ of every node but the first, or NULL */
} Swept;

INLINE void sweep_along(const Case *c, const double *z, Swept *swept, const int width, const int wanted) {
  const int size = column_size(c->track.rk);
  double *x = swept->x, *along = swept->along;
  start_state(c, z, x);
  start_along(c, z, along, width, wanted);
  if (wanted > NZ) force_along(c, along, width);
  behind_along(c->start, x, along, width);
  for (int k = 0; k <= c->track.steps; k++) {
    if (k > 0 && swept->positions)
      for (int r = 0; r < 3; r++)
        memcpy(swept->positions + ((size_t)(k - 1) * 3 + r) * NZ, along + (AT_POSITION + r) * width, sizeof(double) * NZ);
    if (k == c->track.steps) break;
    const double *column = c->columns + (size_t)k * size;
    double ends[2 * TUBES];
    Motion motion = {c->shift + (size_t)k * 3 * TUBES * c->track.rk->stages, ends};
    if (wanted > NZ) step_ends(c->layout, k, ends);
    advance_along(&c->track, column, c->flags[k], wanted > NZ ? &motion : NULL, ALONG_TRANSLATION, x, along,
                  width);
    if (c->flags[k] & LOADED) behind_along(point_data(c->track.rk, column), x, along, width);
  }
}

/* Residual and its Jacobian (NZ x NZ) by the unknowns. */
INLINE void tip_conditions(const Swept *swept, const int width, double *residual, double *jacobian) {
  for (int i = 0; i < NZ; i++) {
    residual[i] = swept->x[TIP_ROWS[i]];
    memcpy(jacobian + i * NZ, swept->along + TIP_ROWS[i] * width, sizeof(double) * NZ);
  }
}

static void linearize(const Case *c, const double *z, double *residual, double *jacobian, double *positions) {
  double along[NX * PADDED(NZ)];
  Swept swept = {.along = along, .positions = positions};
  sweep_along(c, z, &swept, PADDED(NZ), NZ);
  tip_conditions(&swept, PADDED(NZ), residual, jacobian);
}

/* Residual; states at the nodes and the sum of the steps' local errors, as far as wanted. */
static void shoot(const Case *c, const double *z, double *residual, double *right, double *left, double *error) {
  double x[NX], y[NX];
  start_state(c, z, x);
  behind(x, c->start, y);
  sweep(&c->track, y, right, left, error);
  for (int i = 0; i < NZ; i++) residual[i] = y[TIP_ROWS[i]];
}
