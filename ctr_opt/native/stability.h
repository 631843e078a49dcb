/* The number of directions in which the potential energy falls: see transcription/second_variation.py, which derives the
   steps taken here, backward from the tip. Negative: not defined, or the steps are too coarse to decide. */

enum { UNDECIDED = -1, MANY = 2 * (2 + TUBES), COUNTED = PADDED(MANY) };

#if LIVE
static int unstable_directions(const Case *c, const double *right, int parts, double *margin) { return UNDECIDED; }
#else
typedef struct {
  double transfer[MANY * MANY], flexibility[MANY / 2];
} Linear;

static int count(const Case *c, const Linear *linear, double shift) {
  double w[MANY * MANY / 4] = {0}, before[MANY * MANY / 4], negative, lost, total = 0.0;
  for (int k = c->track.steps - 1; k >= 0; k--) {
    eliminate(w, linear[k].transfer, linear[k].flexibility, &shift, before, &negative, &lost);
    if (lost != 0.0) return UNDECIDED;
    total += negative;
    memcpy(w, before, sizeof w);
  }
  entry(w, c->compliance, &shift, &negative);
  return (int)(total + negative);
}

/* The count from the states `right` where steps began before each was cut into `parts`. The margin is the smallest size of
   an eigenvalue that is distinguished from zero. It is negative if some eigenvalue is not: then the second variation is not
   positive, though it may have no negative direction. */
static int unstable_directions(const Case *c, const double *right, int parts, double *margin) {
  Linear *linear = take(sizeof(Linear) * c->track.steps);
  if (!linear) return UNDECIDED;
  const int size = column_size(c->track.rk);
  double x[NX];
  *margin = MARGIN;
  for (int k = 0; k < c->track.steps; k++) {
    const double *column = c->columns + (size_t)k * size;
    double along[NX * COUNTED], doubtful, defect;
    if (k % parts == 0) memcpy(x, right + (size_t)(k / parts) * NX, sizeof x);
    directions(x, along);
    advance_along(&c->track, column, c->flags[k], x, along, COUNTED);
    if (c->flags[k] & LOADED) behind_along(point_data(c->track.rk, column), x, along, COUNTED);
    end_of_step(x, along, column, linear[k].transfer, linear[k].flexibility, &doubtful, &defect);
    if (doubtful != 0.0 || !(defect < 1.0)) return UNDECIDED;
    *margin = fmax(*margin, defect);
  }
  const int negative = count(c, linear, *margin);
  if (negative <= 0) return negative;
  *margin = -*margin;
  return count(c, linear, *margin);
}
#endif
