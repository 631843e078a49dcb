/* Small dense linear algebra, row by row. */

/* Solve A X = B by elimination with column pivots; A (n x n) is lost, B (n x m) becomes X. Nonzero: A is singular. */
static int solve(int n, int m, double *a, double *b) {
  for (int k = 0; k < n; k++) {
    int best = k;
    for (int i = k + 1; i < n; i++)
      if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
    if (!(fabs(a[best * n + k]) > 0.0)) return 1;
    if (best != k) {
      for (int j = 0; j < n; j++) { const double t = a[k * n + j]; a[k * n + j] = a[best * n + j]; a[best * n + j] = t; }
      for (int j = 0; j < m; j++) { const double t = b[k * m + j]; b[k * m + j] = b[best * m + j]; b[best * m + j] = t; }
    }
    const double scale = 1.0 / a[k * n + k];
    for (int i = k + 1; i < n; i++) {
      const double factor = a[i * n + k] * scale;
      for (int j = k + 1; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
      for (int j = 0; j < m; j++) b[i * m + j] -= factor * b[k * m + j];
    }
  }
  for (int k = n - 1; k >= 0; k--)
    for (int j = 0; j < m; j++) {
      double sum = b[k * m + j];
      for (int i = k + 1; i < n; i++) sum -= a[k * n + i] * b[i * m + j];
      b[k * m + j] = sum / a[k * n + k];
    }
  return 0;
}

static int inverse(int n, const double *a, double *result) {
  double copy[MOST_UNKNOWNS * MOST_UNKNOWNS];
  memcpy(copy, a, sizeof(double) * n * n);
  memset(result, 0, sizeof(double) * n * n);
  for (int i = 0; i < n; i++) result[i * n + i] = 1.0;
  return solve(n, n, copy, result);
}

static void multiply(int n, int m, int k, const double *a, const double *b, double *result) {
  for (int i = 0; i < n; i++)
    for (int j = 0; j < k; j++) {
      double sum = 0.0;
      for (int l = 0; l < m; l++) sum += a[i * m + l] * b[l * k + j];
      result[i * k + j] = sum;
    }
}

static double norm(int n, const double *a) {
  double sum = 0.0;
  for (int i = 0; i < n; i++) sum += a[i] * a[i];
  return sqrt(sum);
}

static double largest(int n, const double *a) {
  double most = 0.0;
  for (int i = 0; i < n; i++)
    if (!(fabs(a[i]) <= most)) most = fabs(a[i]); /* NaN included */
  return most;
}
