/* The boundary-value problem: unknown moments (and force) at the entry, conditions at the tip. */

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

/* The change of the state at the entry when an unknown changes by so much. */
static void start_unknown(const Case *c, int unknown, double change, double *along, const int width) {
  const int i = unknown - 2;
  if (i < 0) {
    along[(AT_BENDING + unknown) * width] = change;
  } else if (i < TUBES) {
    along[(AT_TORSION + i) * width] = change;
    along[(AT_ANGLES + i) * width] = c->compliance[i] * change;
  } else {
    along[(AT_FORCE + i - TUBES) * width] = change;
  }
}

/* Residual and its Jacobian (NZ x NZ) by the unknowns; that of the positions at all nodes but the first (3 x NZ each), if
   wanted. */
static void linearize(const Case *c, const double *z, double *residual, double *jacobian, double *positions) {
  enum { WIDTH = PADDED(NZ) };
  const int size = column_size(c->track.rk);
  double x[NX], along[NX * WIDTH] = {0};
  start_state(c, z, x);
  for (int i = 0; i < NZ; i++) start_unknown(c, i, 1.0, along + i, WIDTH);
  behind_along(c->start, x, along, WIDTH);
  for (int k = 0; k < c->track.steps; k++) {
    const double *column = c->columns + (size_t)k * size;
    advance_along(&c->track, column, c->flags[k], x, along, WIDTH);
    if (c->flags[k] & LOADED) behind_along(point_data(c->track.rk, column), x, along, WIDTH);
    for (int r = 0; positions && r < 3; r++)
      memcpy(positions + ((size_t)k * 3 + r) * NZ, along + (AT_POSITION + r) * WIDTH, sizeof(double) * NZ);
  }
  for (int i = 0; i < NZ; i++) {
    residual[i] = x[TIP_ROWS[i]];
    memcpy(jacobian + i * NZ, along + TIP_ROWS[i] * WIDTH, sizeof(double) * NZ);
  }
}

/* Residual; states at the nodes and the sum of the steps' local errors, as far as wanted. */
static void shoot(const Case *c, const double *z, double *residual, double *right, double *left, double *error) {
  double x[NX], y[NX];
  start_state(c, z, x);
  behind(x, c->start, y);
  sweep(&c->track, y, right, left, error);
  for (int i = 0; i < NZ; i++) residual[i] = y[TIP_ROWS[i]];
}
