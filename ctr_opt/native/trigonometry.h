/* Generated and hand-written C of ctr_opt, one translation unit. Sine and cosine first: inline and without branches, so
   that the compiler evaluates both together and several tubes side by side. */

#include <math.h>
#if !defined(_WIN32)
#include <pthread.h>
#endif
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static const double LARGEST_ANGLE = 1e6; /* of a tube at the entry, rad */

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#define INLINE static inline __attribute__((always_inline))

typedef struct {
  double rest, quarter; /* angle = rest + quarter * pi / 2, |rest| <= pi / 4 */
} Reduced;

/* Two parts of pi / 2, the first of 33 bits, so that its first million multiples are exact: see LARGEST_ANGLE. */
INLINE Reduced reduced(double angle) {
  const double quarter = nearbyint(angle * 0.63661977236758134308);
  const double rest = (angle - quarter * 1.57079632673412561417e+00) - quarter * 6.07710050650619224932e-11;
  return (Reduced){rest, quarter};
}

/* Taylor's series, summed in pairs to shorten the chain: the terms left out are below 1e-17 at pi / 4. */
INLINE double series_sin(double x) {
  const double y = x * x, z = y * y, w = z * z;
  const double low = (-1.0 / 6 + y * (1.0 / 120)) + z * (-1.0 / 5040 + y * (1.0 / 362880));
  const double high = (-1.0 / 39916800 + y * (1.0 / 6227020800)) + z * (-1.0 / 1307674368000);
  return x + x * y * (low + w * high);
}

INLINE double series_cos(double x) {
  const double y = x * x, z = y * y, w = z * z;
  const double low = (-1.0 / 2 + y * (1.0 / 24)) + z * (-1.0 / 720 + y * (1.0 / 40320));
  const double high = (-1.0 / 3628800 + y * (1.0 / 479001600)) + z * (-1.0 / 87178291200 + y * (1.0 / 20922789888000));
  return 1.0 + y * (low + w * high);
}

INLINE double model_sin(double angle) {
  const Reduced r = reduced(angle);
  const double half = r.quarter * 0.5, odd = r.quarter - 2.0 * floor(half);     /* 0 or 1 */
  const double sign = 1.0 - 2.0 * (floor(half) - 2.0 * floor(0.5 * floor(half))); /* quarters 2, 3: negative */
  return sign * (odd != 0.0 ? series_cos(r.rest) : series_sin(r.rest));
}

INLINE double model_cos(double angle) {
  const Reduced r = reduced(angle);
  const double next = r.quarter + 1.0, half = next * 0.5, odd = next - 2.0 * floor(half);
  const double sign = 1.0 - 2.0 * (floor(half) - 2.0 * floor(0.5 * floor(half)));
  return sign * (odd != 0.0 ? series_cos(r.rest) : series_sin(r.rest));
}

/* Sines and cosines of the tubes' angles; the lanes to spare take what stands behind them in the state. */
INLINE void circle(const double *restrict angles, double *restrict sines, double *restrict cosines) {
  for (int i = 0; i < LANES; i++) {
    sines[i] = model_sin(angles[i]);
    cosines[i] = model_cos(angles[i]);
  }
}

/* A Runge-Kutta method; the matrix row by row, and the weights of two estimates of its local error, or zeros. */
typedef struct {
  int stages;
  const double *matrix, *weights, *nodes, *fifth, *third;
} Tableau;
