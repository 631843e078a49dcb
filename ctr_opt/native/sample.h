/* The shape at many places, in ascending order, from the states at the nodes.

   Each place has a step of its own, from the node before it. These steps are laid out like those of the solve, section by
   section, so that they have the same tubes and loads. The data of the equations at a place are those of the last node of
   its step. */

/* The step of the solve in which a place lies: from the right, or from the left if that is wanted or it is the tip. */
static int step_at(const Layout *layout, double s, int left) {
  int low = 0, high = layout->steps;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    const double start = layout->step[middle].start;
    if (left ? start < s : start <= s) low = middle; else high = middle;
  }
  return low;
}

/* Steps from nodes to places; `node` is the step of the solve that each begins with. */
static int step_to_places(const Layout *layout, int count, const double *s, const int *left, Layout *places, int *node) {
  *places = *layout;
  places->steps = count;
  places->step = take(sizeof(Step) * count);
  places->last = take(sizeof(int) * layout->breaks);
  if (!places->step || !places->last) return NO_MEMORY;
  places->last[0] = -1;
  int next = 0;
  for (int section = 0; section + 1 < layout->breaks; section++) {
    for (; next < count; next++) {
      node[next] = step_at(layout, s[next], left[next]);
      const Step step = layout->step[node[next]];
      if (step.section != section) break;
      places->step[next] = (Step){step.start, s[next], section};
    }
    places->last[section + 1] = next - 1;
  }
  return next == count ? 0 : REFUSED;
}
