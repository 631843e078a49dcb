/* Integration along the robot, alone and with directions of change.

   An explicit Runge-Kutta method takes the state x over a step of length h by x_j = x + h sum_i a_ji k_i, k_j = f(x_j) and
   x + h sum_j b_j k_j. A direction dx of change obeys the same recursion linearized: dk_j = f'(x_j) dx_j, with dx_j formed
   from dx and dk_i by the same coefficients. That is the exact derivative of the discrete step, whatever the step's error.
   Where the step's length or its data change too, h dk_j gains k_j dh and (df/d data) d data: the forcing.

   f' is applied in two sparse factors: first the turn phi of the frame and the change du of the curvature that dx makes (5
   numbers, `inner`), then the change of f by dx itself, phi and du (`outer`). A block of directions stands side by side,
   width numbers for each entry of the state, so that the compiler works on all of them at once. `record` keeps the factors
   of each stage, `carry` takes one block of directions through what was recorded.

   The model (rates, slopes, behind) is generated from the symbolic equations. The data of a step stand in a column of
   numbers: its length, the parts PART_SIZE, and the point load at its end. */

enum { DISTRIBUTED = 1, VARYING = 2, LOADED = 4 }; /* loads per length; precurvature that varies; a point load ends it */

typedef struct {
  const Tableau *rk;
  int steps;
  const double *columns; /* one behind the other, column_size(rk) each */
  const int *flags;
  int start[PARTS];      /* where each part begins in a column */
  double weight[NX];     /* of errors of the states: roughly by how much a position moves with them */
} Track;

INLINE int column_size(const Tableau *rk) { return 1 + SHARED + AT_NODES * rk->stages + POINT; }

INLINE const double *point_data(const Tableau *rk, const double *column) { return column + column_size(rk) - POINT; }

/* Where a part begins in a column. */
static int part_start(const Tableau *rk, int part) {
  int start = 1;
  for (int i = 0; i < part; i++) start += PART_AT_NODES[i] ? PART_SIZE[i] * rk->stages : PART_SIZE[i];
  return start;
}

/* Where the data of a node stand. */
INLINE void at_node(const Track *track, const double *column, int node, const double **data) {
  for (int i = 0; i < PARTS; i++) data[i] = column + track->start[i] + PART_AT_NODES[i] * PART_SIZE[i] * node;
}

/* Rows of the state on which rates depend: under dead loads not the position, nor a force that stays as it is. */
#define FIRST_ROW (LIVE ? 0 : AT_ORIENTATION)
#define ROWS_END(flags) (LIVE || ((flags) & DISTRIBUTED) ? NX : AT_FORCE)

/* The state at the end of a step, before its point load. Estimated size of the local error, if wanted, as DOP853 does:
   from two embedded formulas of lower order. */
INLINE void advance_as(const Track *track, const double *column, const int flags, double *restrict x, double *error) {
  const Tableau *rk = track->rk;
  double slope[MOST_STAGES][NX], inner[NX];
  const double length = column[0];
  const int end = ROWS_END(flags);
  memcpy(inner, x, sizeof inner);
  for (int j = 0; j < rk->stages; j++) {
    const double *row = rk->matrix + j * rk->stages, *data[PARTS];
    double sum[NX] = {0};
    for (int i = 0; i < j; i++)
      if (row[i] != 0.0)
        for (int r = FIRST_ROW; r < end; r++) sum[r] += row[i] * slope[i][r];
    for (int r = FIRST_ROW; r < end; r++) inner[r] = x[r] + length * sum[r];
    at_node(track, column, j, data);
    if (flags & DISTRIBUTED) rates(inner, data, slope[j]);
    else free_rates(inner, data, slope[j]);
  }
  if (error) {
    double fifth[NX] = {0}, third[NX] = {0}, a = 0.0, b = 0.0;
    for (int i = 0; i < rk->stages; i++)
      for (int r = 0; r < end; r++) {
        fifth[r] += rk->fifth[i] * slope[i][r];
        third[r] += rk->third[i] * slope[i][r];
      }
    for (int r = 0; r < end; r++) {
      const double weight = track->weight[r];
      a += weight * weight * fifth[r] * fifth[r];
      b += weight * weight * third[r] * third[r];
    }
    *error += a > 0.0 ? length * a / sqrt(a + 0.01 * b) : 0.0;
  }
  double sum[NX] = {0};
  for (int i = 0; i < rk->stages; i++)
    for (int r = 0; r < end; r++) sum[r] += rk->weights[i] * slope[i][r];
  for (int r = 0; r < end; r++) x[r] += length * sum[r];
}

static void advance(const Track *track, const double *column, int flags, double *restrict x, double *error) {
  if (flags & DISTRIBUTED) advance_as(track, column, DISTRIBUTED, x, error); /* constants, for the compiler */
  else advance_as(track, column, 0, x, error);
}

/* The state behind the last load, from that at the entry point. `right`, `left` (steps + 1 and steps states, or NULL):
   behind and before the loads at the nodes. */
static void sweep(const Track *track, double *x, double *right, double *left, double *error) {
  const int size = column_size(track->rk);
  if (right) memcpy(right, x, sizeof(double) * NX);
  for (int k = 0; k < track->steps; k++) {
    const double *column = track->columns + (size_t)k * size;
    advance(track, column, track->flags[k], x, error);
    if (left) memcpy(left + (size_t)k * NX, x, sizeof(double) * NX);
    if (track->flags[k] & LOADED) {
      double y[NX];
      behind(x, point_data(track->rk, column), y);
      memcpy(x, y, sizeof y);
    }
    if (right) memcpy(right + (size_t)(k + 1) * NX, x, sizeof(double) * NX);
  }
}

/* The equations linearized along a step, a block of numbers for each stage: the rate, and the nonzeros of its derivatives by
   parts, the outer ones times the step's length; `by_data` with those by the data. */
typedef struct {
  int size, outer; /* of a block, and where the outer ones begin in it */
} Blocks;

INLINE Blocks blocks(const int by_data) {
  return by_data ? (Blocks){NX + INNER_BY_DATA + OUTER_BY_DATA, NX + INNER_BY_DATA} : (Blocks){NX + INNER + OUTER, NX + INNER};
}

/* A step, and the equations along it. */
INLINE void record(const Track *track, const double *column, const int flags, const int by_data, double *restrict x,
                   double *restrict linear) {
  const Tableau *rk = track->rk;
  const Blocks of = blocks(by_data);
  const double length = column[0];
  const int end = ROWS_END(flags);
  double inner[NX];
  memcpy(inner, x, sizeof inner);
  for (int j = 0; j < rk->stages; j++) {
    const double *row = rk->matrix + j * rk->stages, *data[PARTS];
    double sum[NX] = {0};
    for (int i = 0; i < j; i++)
      if (row[i] != 0.0)
        for (int r = FIRST_ROW; r < end; r++) sum[r] += row[i] * linear[i * of.size + r];
    for (int r = FIRST_ROW; r < end; r++) inner[r] = x[r] + length * sum[r];
    at_node(track, column, j, data);
    double *slope = linear + j * of.size, *by_parts = slope + NX, *outer = slope + of.outer;
    if (by_data && flags & DISTRIBUTED) slopes_by_data(inner, data, slope, by_parts, outer);
    else if (by_data) free_slopes_by_data(inner, data, slope, by_parts, outer);
    else if (flags & DISTRIBUTED) slopes(inner, data, slope, by_parts, outer);
    else free_slopes(inner, data, slope, by_parts, outer);
    const int nonzeros = !by_data ? OUTER : flags & DISTRIBUTED ? OUTER_BY_DATA : OUTER_BY_TUBES;
    for (int k = 0; k < nonzeros; k++) outer[k] *= length;
  }
  for (int i = 0; i < rk->stages; i++)
    for (int r = 0; r < end; r++) x[r] += length * rk->weights[i] * linear[i * of.size + r];
}

/* By how much directions lengthen a step, and how they change its data (DATA x width, or NULL): `at_stage` writes those
   that vary along it, where the others stand. */
typedef struct {
  void (*at_stage)(void *of, int stage);
  void *of;
  const double *change, *longer;
} Forcing;

/* Directions `along` (NX x width) through a recorded step. */
INLINE void carry(const Track *track, const double *linear, const int flags, const int by_data, const Forcing *forcing,
                  double *restrict along, const int width) {
  const Blocks of = blocks(by_data);
  const Tableau *rk = track->rk;
  const int end = ROWS_END(flags);
  double turned[MOST_STAGES][NX * width], aside[NX * width], part[5 * width];
  memcpy(aside, along, sizeof aside);
  for (int j = 0; j < rk->stages; j++) {
    const double *row = rk->matrix + j * rk->stages;
    int used[MOST_STAGES], count = 0;
    for (int i = 0; i < j; i++)
      if (row[i] != 0.0) used[count++] = i;
    for (int r = FIRST_ROW; r < end; r++) {
      double sums[width];
      for (int k = 0; k < width; k++) sums[k] = along[r * width + k];
      for (int m = 0; m < count; m++) {
        const double weight = row[used[m]], *add = turned[used[m]] + r * width;
        for (int k = 0; k < width; k++) sums[k] += weight * add[k];
      }
      for (int k = 0; k < width; k++) aside[r * width + k] = sums[k];
    }
    const double *slope = linear + j * of.size, *by_parts = slope + NX, *outer = slope + of.outer;
    if (forcing && forcing->change) {
      const double *change = forcing->change;
      forcing->at_stage(forcing->of, j);
      apply_by_parts_and_data(by_parts, aside, change, part, width);
      if (flags & DISTRIBUTED) apply_slopes_and_data(outer, aside, part, change, turned[j], width);
      else apply_slopes_and_tubes(outer, aside, part, change, turned[j], width);
    } else {
      apply_by_parts(by_parts, aside, part, width);
      apply_slopes(outer, aside, part, turned[j], width);
    }
    for (int r = 0; forcing && r < NX; r++)
      for (int k = 0; k < width; k++) turned[j][r * width + k] += forcing->longer[k] * slope[r];
  }
  for (int i = 0; i < rk->stages; i++) {
    const double weight = rk->weights[i];
    if (weight == 0.0) continue;
    for (int k = 0; k < end * width; k++) along[k] += weight * turned[i][k];
  }
}

/* A step with directions of change of the state alone. */
INLINE void advance_along(const Track *track, const double *column, const int flags, double *restrict x,
                          double *restrict along, const int width) {
  double linear[MOST_STAGES * (NX + INNER + OUTER)];
  record(track, column, flags, 0, x, linear);
  carry(track, linear, flags, 0, NULL, along, width);
}

/* State and directions behind a point load. */
INLINE void behind_along(const double *point, double *restrict x, double *restrict along, const int width) {
  double inner[BEHIND_INNER], outer[BEHIND_OUTER], part[3 * width], moved[NX * width], y[NX];
  behind_slopes(x, point, inner, outer);
  apply_turn(inner, along, part, width);
  apply_behind(outer, along, part, moved, width);
  memcpy(along, moved, sizeof moved);
  behind(x, point, y);
  memcpy(x, y, sizeof y);
}
