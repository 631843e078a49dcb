/* From robot, actuation and loads to break points, sections and steps. SI throughout.

   The equations are smooth except where something begins or ends: a piece of precurvature, a tube, a load. These break points
   are collected from everything that has one, sorted along the arc length, and those closer than SAME_POINT of the length
   are merged, as decimal inputs place equal points apart by rounding. What lies between two of them is a section, in which
   the tubes present and their polynomials are fixed. All queries about a section are made at its middle, so that no
   comparison happens at a point where the answer changes. A section is cut into equal steps, none of which turns more
   than LARGEST_TURN by a bound from the precurvatures, moments and forces.

   Every break point knows what moves it, its mover: the tube that carries it, the arc length of a point load, or nothing.
   Derivatives by translations and places follow from the movers. Where different movers meet at one point, a derivative
   would depend on the direction in which they part: such movers are `tied`, and their derivatives are refused. */

/* What moves a break point: a tube, i; the arc length of a point load, TUBES + k; nothing. A point row of zeros breaks no
   step, so that it may lie anywhere: it is IDLE. */
enum { IDLE = -2, FIXED = -1 };

typedef struct {
  double s;
  int mover;
} Break;

typedef struct {
  double start, end;
  int section;
} Step;

typedef struct {
  const Robot *robot;
  const Loads *loads;
  const double *rotations, *translations;
  double ends[TUBES], length, stiffness;
  double same, beyond; /* distance within which points are one; how far a load may be beyond its tube's end */
  int breaks;
  Break *at;
  int *of_point, *of_span; /* break points of the loads: one each, two each */
  int *tied; /* of each mover (TUBES + points): whether something else is where it is, and would be parted from it */
  int steps;
  Step *step;
  int *last; /* of each break point: the step that ends there */
} Layout;

/* -- memory: one arena for each thread, emptied by every call and freed when the thread ends ---------------------------- */

typedef struct Block {
  struct Block *before;
  size_t size, used;
} Block;

static _Thread_local Block *arena;

static void release(void *newest) {
  for (Block *block = newest; block;) {
    Block *before = block->before;
    free(block);
    block = before;
  }
}

#if defined(_WIN32)
static void release_at_thread_end(Block *newest) {}
#else
static pthread_key_t thread_end;
static int have_thread_end;
static pthread_once_t once = PTHREAD_ONCE_INIT;
static void make_thread_end(void) { have_thread_end = !pthread_key_create(&thread_end, release); }
static void release_at_thread_end(Block *newest) {
  pthread_once(&once, make_thread_end);
  if (have_thread_end) pthread_setspecific(thread_end, newest);
}
#endif

static void *take(size_t bytes) {
  bytes = (bytes + 63) / 64 * 64;
  if (!arena || arena->size - arena->used < bytes) {
    const size_t size = bytes + (arena ? 2 * arena->size : (size_t)1 << 16);
    Block *block = malloc(sizeof(Block) + 64 + size);
    if (!block) return NULL;
    *block = (Block){arena, size, 0};
    arena = block;
    release_at_thread_end(arena);
  }
  char *begin = (char *)(((uintptr_t)(arena + 1) + 63) / 64 * 64);
  void *room = begin + arena->used;
  arena->used += bytes;
  return room;
}

static void empty(void) {
  if (!arena) return;
  release(arena->before); /* the last and largest is kept */
  arena->before = NULL;
  arena->used = 0;
}

/* -- tubes' numbers ----------------------------------------------------------------------------------------------------- */

static const double *stiffness_of(const Robot *robot, int tube) { return robot->stiffness + STIFFNESSES * tube; }

/* -- precurvature ------------------------------------------------------------------------------------------------------ */

static int piece_of(const Robot *robot, int tube, double sigma) {
  int low = robot->pieces[tube], high = robot->pieces[tube + 1];
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (robot->breaks[middle + tube] <= sigma) low = middle; else high = middle;
  }
  return low;
}

/* u*(sigma) on a piece, and its slope if wanted. */
static void precurvature(const Robot *robot, int tube, int piece, double sigma, double *value, double *slope) {
  const double x = sigma - robot->breaks[piece + tube];
  const double *c = robot->coefficients + (size_t)piece * (robot->degree + 1) * 3;
  for (int r = 0; r < 3; r++) {
    double v = 0.0, d = 0.0;
    for (int k = robot->degree; k >= 0; k--) {
      d = d * x + v;
      v = v * x + c[3 * k + r];
    }
    value[r] = v;
    if (slope) slope[r] = d;
  }
}

/* Integral of u*_z over [0, sigma] of a tube. */
static double preset_twist(const Robot *robot, int tube, double sigma) {
  double total = 0.0;
  for (int piece = robot->pieces[tube]; piece < robot->pieces[tube + 1]; piece++) {
    const double begin = robot->breaks[piece + tube], end = robot->breaks[piece + 1 + tube];
    const double x = fmin(sigma, end) - begin;
    const double *c = robot->coefficients + (size_t)piece * (robot->degree + 1) * 3;
    if (x <= 0.0) break;
    double sum = 0.0;
    for (int k = robot->degree; k >= 0; k--) sum = sum * x + c[3 * k + 2] / (k + 1);
    total += sum * x;
  }
  return total;
}

/* -- break points ------------------------------------------------------------------------------------------------------ */

static int by_arc_length(const void *a, const void *b) {
  const Break *x = a, *y = b;
  return x->s < y->s ? -1 : x->s > y->s ? 1 : x->mover - y->mover;
}

static int nearest(const Layout *layout, double s) {
  int low = 0, high = layout->breaks - 1;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (layout->at[middle].s <= s) low = middle; else high = middle;
  }
  return s - layout->at[low].s <= layout->at[high].s - s ? low : high;
}

/* Where a load acts: on its tube, or refused. */
static int place(const Layout *layout, double s, double index, Break *point) {
  if (!(index < TUBES)) return REFUSED; /* perhaps too large for an int */
  const int tube = (int)index;
  const double end = layout->ends[tube];
  if (isnan(s)) {
    *point = (Break){end, tube};
    return 0;
  }
  if (!(s >= 0.0 && s <= end + layout->beyond)) return REFUSED;
  *point = (Break){s - end <= layout->same ? fmin(s, end) : s, FIXED};
  return 0;
}

/* A point row rides on a tube's end, is idle, or moves with its own arc length. */
static int point_mover(const PointLoad *load, int k, int mover) {
  if (mover != FIXED) return mover;
  return largest(3, load->force) == 0.0 && largest(3, load->moment) == 0.0 ? IDLE : TUBES + k;
}

/* Another mover at a break point. */
static void join(Layout *layout, Break *at, int mover) {
  if (mover == IDLE || mover == at->mover) return;
  if (at->mover == IDLE) {
    at->mover = mover;
    return;
  }
  if (at->mover >= 0) layout->tied[at->mover] = 1;
  if (mover >= 0) layout->tied[mover] = 1;
}

static int sort_breaks(Layout *layout) {
  const Robot *robot = layout->robot;
  const Loads *loads = layout->loads;
  const size_t most = 2 + robot->pieces[TUBES] + TUBES + loads->points + 2 * (size_t)loads->spans;
  Break *all = layout->at = take(sizeof(Break) * most);
  layout->of_point = take(sizeof(int) * (2 * (size_t)loads->points + TUBES + 2 * (size_t)loads->spans + most));
  if (!all || !layout->of_point) return NO_MEMORY;
  layout->of_span = layout->of_point + loads->points;
  layout->last = layout->of_span + 2 * loads->spans;
  layout->tied = layout->last + most;
  memset(layout->tied, 0, sizeof(int) * (TUBES + loads->points));
  int count = 0;
  const double slack = layout->same;
  all[count++] = (Break){0.0, FIXED};
  for (int i = 0; i < TUBES; i++) /* bases are behind the entry point, or there and can only be drawn back */
    for (int k = robot->pieces[i] + i + 1; k <= robot->pieces[i + 1] + i; k++) {
      const double s = layout->translations[i] + robot->breaks[k];
      if (s >= -slack) all[count++] = (Break){fmax(s, 0.0), i};
    }
  for (int k = 0; k < loads->points; k++) {
    const PointLoad *load = loads->point + k;
    if (place(layout, load->s, load->tube, all + count)) return REFUSED;
    all[count].mover = point_mover(load, k, all[count].mover);
    count++;
  }
  for (int k = 0; k < loads->spans; k++) {
    for (int side = 0; side < 2; side++)
      if (place(layout, loads->span[k].ends[side], loads->span[k].tube, all + count++)) return REFUSED;
    if (!(all[count - 1].s > all[count - 2].s)) return REFUSED;
  }
  qsort(all, count, sizeof *all, by_arc_length);
  /* Chains of close points are one: each is compared with the one before it, not with the first. */
  layout->breaks = 1;
  double before = all[0].s;
  for (int k = 1; k < count; k++) {
    const Break next = all[k];
    if (next.s - before > slack) layout->at[layout->breaks++] = next;
    else join(layout, layout->at + layout->breaks - 1, next.mover);
    before = next.s;
  }
  layout->at[layout->breaks - 1].s = layout->length;
  /* From here on, ends and loads stand exactly at break points. */
  for (int i = 0; i < TUBES; i++) layout->ends[i] = layout->at[nearest(layout, layout->ends[i])].s;
  for (int k = 0; k < loads->points; k++) {
    const PointLoad *load = loads->point + k;
    layout->of_point[k] = nearest(layout, isnan(load->s) ? layout->ends[(int)load->tube] : load->s);
  }
  for (int k = 0; k < 2 * loads->spans; k++) {
    const double s = loads->span[k / 2].ends[k % 2];
    layout->of_span[k] = nearest(layout, isnan(s) ? layout->ends[(int)loads->span[k / 2].tube] : s);
  }
  return 0;
}

/* -- steps ------------------------------------------------------------------------------------------------------------- */

static double size3(const double *v) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* A rough upper bound of the curvature in a section from the preset curvatures. */
static double preset_bound(const Layout *layout, double start, double end, double *stiffness) {
  const Robot *robot = layout->robot;
  const double middle = 0.5 * (start + end);
  double most = 0.0;
  *stiffness = 0.0;
  for (int i = 0; i < TUBES; i++) {
    if (middle >= layout->ends[i]) continue;
    *stiffness += stiffness_of(robot, i)[BENDING_STIFFNESS];
    const int piece = piece_of(robot, i, middle - layout->translations[i]);
    for (int j = 0; j < (robot->degree ? 5 : 1); j++) {
      double value[3];
      precurvature(robot, i, piece, start + 0.25 * j * (end - start) - layout->translations[i], value, NULL);
      most = fmax(most, largest(3, value));
    }
  }
  return most;
}

/* How many steps every section takes: no step turns much. The rule of Configuration.mesh, with the loads from the tip on:
   a force bends an elastica to at most 2 sqrt(F / EI), however long the lever. */
static int steps_of(Layout *layout, int *parts, double *turns) {
  const Loads *loads = layout->loads;
  double *forces = take(sizeof(double) * 2 * layout->breaks);
  if (!forces) return NO_MEMORY;
  double *couples = forces + layout->breaks;
  memset(forces, 0, sizeof(double) * 2 * layout->breaks);
  for (int p = 0; p < loads->points; p++) {
    forces[layout->of_point[p]] += size3(loads->point[p].force);
    couples[layout->of_point[p]] += size3(loads->point[p].moment);
  }
  for (int p = 0; p < loads->spans; p++) {
    const int from = layout->of_span[2 * p], to = layout->of_span[2 * p + 1];
    const double length = layout->at[to].s - layout->at[from].s;
    forces[to] += length * size3(loads->span[p].force);
    couples[to] += length * size3(loads->span[p].moment);
  }
  double total = 0.0, force = 0.0, couple = 0.0, lever = 0.0;
  for (int k = layout->breaks - 2; k >= 0; k--) {
    const double start = layout->at[k].s, end = layout->at[k + 1].s;
    double stiffness;
    const double preset = preset_bound(layout, start, end, &stiffness);
    force += forces[k + 1];
    couple += couples[k + 1];
    lever += (end - start) * force;
    turns[k] = (end - start) * (preset + couple / stiffness + fmin(lever / stiffness, 2.0 * sqrt(force / stiffness)));
    total += turns[k];
  }
  const double allowed = fmax(LARGEST_TURN, total / MOST_STEPS);
  layout->steps = 0;
  for (int k = 0; k + 1 < layout->breaks; k++) {
    if (!(turns[k] < 1e6 * allowed)) return REFUSED;
    parts[k] = turns[k] > allowed ? (int)ceil(turns[k] / allowed) : 1;
    layout->steps += parts[k];
  }
  return 0;
}

static int cut_steps(Layout *layout) {
  int *parts = take(sizeof(int) * layout->breaks);
  double *turns = take(sizeof(double) * layout->breaks);
  if (!parts || !turns) return NO_MEMORY;
  const int refused = steps_of(layout, parts, turns);
  if (refused) return refused;
  layout->step = take(sizeof(Step) * layout->steps);
  if (!layout->step) return NO_MEMORY;
  int next = 0;
  layout->last[0] = -1;
  for (int k = 0; k + 1 < layout->breaks; k++) {
    const double start = layout->at[k].s, length = layout->at[k + 1].s - start;
    for (int j = 0; j < parts[k]; j++) {
      const double a = start + j * (length / parts[k]);
      const double b = j + 1 == parts[k] ? layout->at[k + 1].s : start + (j + 1) * (length / parts[k]);
      layout->step[next++] = (Step){a, b, k};
    }
    layout->last[k + 1] = next - 1;
  }
  return 0;
}

/* Every step in two. */
static int halve(const Layout *layout, Layout *halves) {
  *halves = *layout;
  halves->steps = 2 * layout->steps;
  halves->step = take(sizeof(Step) * halves->steps);
  halves->last = take(sizeof(int) * layout->breaks);
  if (!halves->step || !halves->last) return NO_MEMORY;
  for (int k = 0; k < layout->steps; k++) {
    const Step whole = layout->step[k];
    const double middle = 0.5 * (whole.start + whole.end);
    halves->step[2 * k] = (Step){whole.start, middle, whole.section};
    halves->step[2 * k + 1] = (Step){middle, whole.end, whole.section};
  }
  for (int k = 0; k < layout->breaks; k++) halves->last[k] = 2 * layout->last[k] + 1;
  return 0;
}

/* Tubes' ends that are one point made equal, by the rule of layout/ends.py: the largest of a chain. */
static void chain(double slack, double *ends) {
  double given[TUBES];
  memcpy(given, ends, sizeof given);
  for (int i = 0; i < TUBES; i++)
    for (int j = 0; j < TUBES; j++)
      if (given[j] > ends[i] && given[j] - ends[i] <= slack) {
        ends[i] = given[j];
        j = -1;
      }
}

/* Points are one within `same`, and loads may be beyond their tubes' ends by `beyond`, in SAME_POINT of the length. */
static int lay_out_within(const Robot *robot, const Loads *loads, const double *actuation, double same, double beyond,
                          Layout *layout) {
  *layout = (Layout){.robot = robot, .loads = loads, .rotations = actuation, .translations = actuation + TUBES};
  for (int i = 0; i < TUBES; i++) {
    const double end = layout->translations[i] + robot->breaks[robot->pieces[i + 1] + i];
    if (!(end > 0.0 && layout->translations[i] <= 0.0)) return REFUSED;
    layout->ends[i] = end;
    layout->length = fmax(layout->length, end);
    layout->stiffness = fmax(layout->stiffness, stiffness_of(robot, i)[BENDING_STIFFNESS]);
  }
  layout->same = same * SAME_POINT * layout->length;
  layout->beyond = beyond * SAME_POINT * layout->length;
  chain(layout->same, layout->ends);
  const int refused = sort_breaks(layout);
  return refused ? refused : cut_steps(layout);
}

static int lay_out(const Robot *robot, const Loads *loads, const double *actuation, Layout *layout) {
  return lay_out_within(robot, loads, actuation, 1.0, 1.0, layout);
}
