/* n cells of L = C = 0.01, 1 V at the left and 1 Ohm at the right, at the start 0.1 sin(k) V on the k-th, h = 1 ms, the implicit
   midpoint rule, without ledger. With a = 2L/h = 2C/h and the currents put into the equations of the voltages, the voltages z at the
   midpoint obey
   -z[k-1]/a + (a + 2/a) z[k] - z[k+1]/a = a v[k] + i[k] - i[k+1], which Thomas' algorithm solves with pivots made once: of each
   pass one multiply-add a cell waits for another. */
#include "bench.h"

static const double h = 1e-3, part = 0.01, load = 1.0, u = 1.0;
static int n;
static double *restrict cur, *restrict vol, *restrict y, *restrict pivot;

static double *room(int count) {
    double *at = calloc((size_t)count, sizeof *at);
    if (!at) exit(1);
    return at;
}
static void begin(int size) {
    const double a = 2 * part / h, g = 1.0 / a;
    double d = 0.0;
    int j;
    n = size;
    cur = room(n + 1), vol = room(n), y = room(n), pivot = room(n);
    for (j = 0; j < n; ++j) {
        d = a + 2 * g - (j == 0 ? 0.0 : g * g / d) + (j == n - 1 ? 1.0 / load - g : 0.0);
        pivot[j] = 1.0 / d;
        vol[j] = 0.1 * sin(j + 1);
    }
}
static void steps(long count) {
    const double a = 2 * part / h, g = 1.0 / a;
    long k;
    for (k = 0; k < count; ++k) {
        double r = u, z = 0.0, before;
        int j;
        /* r and z are what comes from the neighbour. */
        for (j = 0; j < n; ++j) {
            const double w = pivot[j];
            r = (a * vol[j] + (cur[j] - cur[j + 1])) * w + r * (g * w);
            y[j] = r;
        }
        for (j = n - 1; j >= 0; --j) {
            before = z;
            z = y[j] + before * (g * pivot[j]);
            vol[j] = 2.0 * z - vol[j];
            if (j < n - 1) cur[j + 1] += 2.0 * g * (z - before);
        }
        cur[0] += 2.0 * g * (u - z);
    }
}
static int look(double *out) {
    out[0] = part * cur[0], out[1] = part * vol[n - 1];
    return 2;
}
#include "bench_main.h"
