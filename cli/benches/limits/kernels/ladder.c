/* n cells of L = C = 0.01, 1 V at the left and 1 Ohm at the right, from rest, h = 1 ms, the implicit midpoint rule, without
   ledger. For the values z at the midpoint, (i1, v1, i2, v2, ...), each row is -z[j-1] + (2L/h) z[j] + z[j+1] = (2L/h) x[j], which
   Thomas' algorithm solves with pivots made once. Of each pair of passes only one multiply-add a value waits for another. */
#include "bench.h"

static const double h = 1e-3, part = 0.01, load = 1.0, u = 1.0;
static int n;
static double *x, *y, *pivot;

static void begin(int size) {
    const double a = 2 * part / h;
    double d = 0.0;
    int j;
    n = 2 * size;
    x = calloc((size_t)n, sizeof *x), y = calloc((size_t)n, sizeof *y), pivot = calloc((size_t)n, sizeof *pivot);
    if (!x || !y || !pivot) exit(1);
    for (j = 0; j < n; ++j) {
        d = a + (j == 0 ? 0.0 : 1.0 / d) + (j == n - 1 ? 1.0 / load : 0.0);
        pivot[j] = 1.0 / d;
    }
}
static void steps(long count) {
    const double a = 2 * part / h;
    long k;
    for (k = 0; k < count; ++k) {
        double r = u, z = 0.0;
        int j;
        /* r is what comes from the left, already divided by its pivot. */
        for (j = 0; j < n; ++j) {
            r = (a * x[j]) * pivot[j] + r * pivot[j];
            y[j] = r;
        }
        for (j = n - 1; j >= 0; --j) {
            z = y[j] - pivot[j] * z;
            x[j] = 2.0 * z - x[j];
        }
    }
}
static int look(double *out) {
    out[0] = part * x[0], out[1] = part * x[n - 1];
    return 2;
}
#include "bench_main.h"
