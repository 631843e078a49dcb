/* Axial forces of the actuators on the tubes' bases, for precurvatures that are constant piece by piece.

   The potential energy of a shape in equilibrium is stationary in everything but its break points. When one at s moves, it
   changes by the jump H(s+) - H(s-) of the Hamiltonian
     H = m_xy . u_xy + sum tau_i u_i,z + n . R e3 - W - V,
   with the elastic energy W and the loads' potential V per arc length (transcription/integrals.py). All break points of a
   tube move with its base, so the force there is the sum of their jumps. Behind the entry point each tube is alone and held
   straight; there the sum telescopes to the tube's own H right behind the entry (mechanics/law.py). Where break points of
   several tubes coincide, only the tube's own part of the jump counts: data change tube by tube, and H is taken before and
   after the tube's own change.

   Where break points coincide, loads at fixed places come first, then the tubes, the innermost first, each with what
   rides on its end. */

/* The equations' data at a place, and their changes with the directions (DATA x BLOCK of each block). */
typedef struct {
  double data[DATA], *change;
} Place;

/* Whether a piece of a tube's precurvature ends at a break point in front of the entry. */
static int moves_at(const Layout *layout, int tube, int at) {
  const Robot *robot = layout->robot;
  for (int k = robot->pieces[tube] + tube + 1; k <= robot->pieces[tube + 1] + tube && at > 0; k++) {
    const double s = layout->translations[tube] + robot->breaks[k];
    if (s >= -layout->same && nearest(layout, fmax(s, 0.0)) == at) return 1;
  }
  return 0;
}

/* What a force on a tube's base takes of the Hamiltonian at a state. */
static void add_hamiltonian(const Lanes *lanes, int tube, double sign, const double *x, const Place *place,
                            Answer *answer) {
  const Layout *layout = lanes->c->layout;
  const double *data[PARTS], *next = place->data, unit = sign * force_scale(layout);
  double value, by_state[NX], by_data[DATA], *rates_ = answer->force_rates + (size_t)tube * lanes->columns;
  for (int i = 0; i < PARTS; next += PART_SIZE[i++]) data[i] = next;
  hamiltonian(x, data, &value, by_state, by_data);
  answer->forces[tube] += unit * value;
  for (int b = 0; b < lanes->blocks; b++) {
    const double *along = lanes->along + (size_t)b * NX * BLOCK, *change = place->change + (size_t)b * DATA * BLOCK;
    double sum[BLOCK] = {0};
    for (int r = 0; r < NX; r++)
      for (int l = 0; l < BLOCK; l++) sum[l] += by_state[r] * along[r * BLOCK + l];
    for (int r = 0; r < DATA; r++)
      for (int l = 0; l < BLOCK; l++) sum[l] += by_data[r] * change[r * BLOCK + l];
    for (int l = 0; l < BLOCK; l++)
      if (lanes->lane[b * BLOCK + l].to >= 0) rates_[lanes->lane[b * BLOCK + l].to] += unit * sum[l];
  }
  for (int k = 0; k < lanes->asked->count; k++) {
    const Direction *of = lanes->asked->directions + k;
    if (!carried(of->kind)) rates_[NZ + k] += unit * by_state[AT_POSITION + of->component] / layout->length;
  }
}

/* The data at a node of a step. */
static void look(const Lanes *lanes, int step, int node, Place *place) {
  const Case *c = lanes->c;
  const double *data[PARTS];
  double *next = place->data;
  at_node(&c->track, c->columns + (size_t)step * column_size(c->track.rk), node, data);
  for (int i = 0; i < PARTS; next += PART_SIZE[i++]) memcpy(next, data[i], sizeof(double) * PART_SIZE[i]);
  for (int b = 0; b < lanes->blocks; b++) {
    Change change = {.lanes = lanes};
    if (begin_change(lanes, b, step, &change) & CHANGED) change_at(&change, node);
    memcpy(place->change + (size_t)b * DATA * BLOCK, change.change, sizeof change.change);
  }
}

/* Some of the data, and their changes, as they are at another place. */
static void take_over(const Lanes *lanes, int first, int count, const Place *from, Place *to) {
  memcpy(to->data + first, from->data + first, sizeof(double) * count);
  for (int b = 0; b < lanes->blocks; b++) {
    const size_t start = ((size_t)b * DATA + first) * BLOCK;
    memcpy(to->change + start, from->change + start, sizeof(double) * count * BLOCK);
  }
}

/* The loads per length that end with a tube, added to the data in front of its end or, with -1, taken off. */
static void add_riding(const Lanes *lanes, int at, int tube, double sign, Place *place) {
  const Layout *layout = lanes->c->layout;
  for (int k = 0; k < layout->loads->spans; k++) {
    const SpanLoad *load = span_load(layout, k);
    const double unit = sign * layout->length / force_scale(layout);
    if (!isnan(load->ends[1]) || (int)load->tube != tube || layout->of_span[2 * k + 1] != at) continue;
    if (turning(load->frame)) continue;
    add3(place->data + DATA_FORCE, load->force, unit);
    for (int n = 0; n < lanes->blocks * BLOCK; n++) {
      const Lane lane = lanes->lane[n];
      if (lane.kind != BY_SPAN_FORCE || lane.index != k) continue;
      place->change[((size_t)(n / BLOCK) * DATA + DATA_FORCE + lane.component) * BLOCK + n % BLOCK] += unit;
    }
  }
}

/* The point loads at a break point that ride on a tube's end (or, FIXED, on none), to state and directions. */
static void jump_some(Lanes *lanes, int at, int rides, double *x) {
  const Layout *layout = lanes->c->layout;
  double point[POINT] = {0};
  int some = 0;
  for (int k = 0; k < layout->loads->points; k++) {
    const PointLoad *load = point_load(layout, k);
    if (layout->of_point[k] != at || rider(load) != rides) continue;
    add_point(layout, load, point);
    some = 1;
  }
  if (some) jump_lanes(lanes, at, rides, point, x);
}

/* State and directions behind a break point in front of the entry that is the end of a step, and the forces' parts. */
static int cross(Lanes *lanes, int at, double *x, Answer *answer) {
  const Case *c = lanes->c;
  const Layout *layout = c->layout;
  const int step = layout->last[at], tip = at + 1 == layout->breaks;
  const size_t changes = (size_t)lanes->blocks * DATA * BLOCK;
  Place here, after = {.data = {0}};
  int last = -1;
  for (int i = 0; i < TUBES; i++)
    if (moves_at(layout, i, at)) last = i;
  if (last < 0) {
    const double *column = c->columns + (size_t)step * column_size(c->track.rk);
    if (c->flags[step] & LOADED) jump_lanes(lanes, at, ALL, point_data(c->track.rk, column), x);
    return 0;
  }
  here.change = take(sizeof(double) * changes);
  after.change = take(sizeof(double) * changes);
  if (!here.change || !after.change) return NO_MEMORY;
  look(lanes, step, last_node(c->track.rk), &here);
  if (tip) memset(after.change, 0, sizeof(double) * changes);
  else look(lanes, step + 1, 0, &after);
  take_over(lanes, DATA_FORCE, 3, &after, &here);
  for (int i = 0; i < TUBES; i++) add_riding(lanes, at, i, 1.0, &here);
  jump_some(lanes, at, FIXED, x);
  for (int i = 0; i < TUBES; i++) {
    const int moved = moves_at(layout, i, at);
    if (moved) add_hamiltonian(lanes, i, -1.0, x, &here, answer);
    jump_some(lanes, at, i, x);
    add_riding(lanes, at, i, -1.0, &here);
    for (int n = 0; n < STIFFNESSES; n++)
      if (!STIFFNESS_EVERYWHERE[n]) take_over(lanes, DATA_STIFFNESS + n * TUBES + i, 1, &after, &here);
    take_over(lanes, DATA_PRECURVATURE + 3 * i, 3, &after, &here);
    if (moved && !(tip && i == last)) add_hamiltonian(lanes, i, 1.0, x, &here, answer);
  }
  return 0;
}

/* The Hamiltonian of each tube alone, held straight behind the entry point. */
static void start_forces(const Lanes *lanes, Answer *answer) {
  const Layout *layout = lanes->c->layout;
  const Robot *robot = layout->robot;
  memset(answer->force_rates, 0, sizeof(double) * TUBES * lanes->columns);
  for (int i = 0; i < TUBES; i++) {
    const double torque = lanes->z[2 + i] * moment_scale(layout);
    const double sigma = layout->same - layout->translations[i];
    const int piece = piece_of(robot, i, sigma);
    double preset[3], by_torque, by_preset[3], by_stiffness[STIFFNESSES];
    double *rates_ = answer->force_rates + (size_t)i * lanes->columns;
    precurvature(robot, i, piece, sigma, preset, NULL);
    straightened(&torque, preset, stiffness_of(robot, i), answer->forces + i, &by_torque, by_preset, by_stiffness);
    rates_[2 + i] = by_torque;
    for (int k = 0; k < lanes->asked->count; k++) {
      const Direction *of = lanes->asked->directions + k;
      if (of->kind == BY_STIFFNESS && of->index == i) rates_[NZ + k] = by_stiffness[of->component];
      if (of->kind != BY_PRECURVATURE || of->component != i) continue;
      const Robot changed = with_table(lanes, of->index);
      double change[3];
      precurvature(&changed, i, piece, sigma, change, NULL);
      for (int r = 0; r < 3; r++) rates_[NZ + k] += by_preset[r] * change[r];
    }
  }
}
