/* 4096 of the Duffing oscillators of `duffing.c`, each from its own start, without ledger: blocks that stay in the cache's
   first level, several oscillators in the lanes of one vector. A block iterates until its slowest one is done. */
#include "bench.h"

enum { COUNT = 4096, BLOCK = 64 };
static const double h = 0.05;
static double q[COUNT], p[COUNT];

static void begin(int size) {
    int i;
    (void)size;
    for (i = 0; i < COUNT; ++i) q[i] = 1.0 + i * (0.5 / COUNT), p[i] = 0.0;
}
static void block(double *restrict a, double *restrict b) {
    const double half = 0.5 * h * h;
    double d[BLOCK];
    int i, k, on;
    for (i = 0; i < BLOCK; ++i) d[i] = h * b[i] - half * (a[i] + a[i] * a[i] * a[i]);
    for (k = 0; k < 50; ++k) {
        on = 0;
        for (i = 0; i < BLOCK; ++i) {
            const double m = a[i] + 0.5 * d[i], mm = m * m + 0.25 * d[i] * d[i];
            const double change =
                (h * b[i] - d[i] - half * (m + m * mm)) / (1.0 + half * (0.5 + 0.5 * mm + m * (m + 0.5 * d[i])));
            d[i] += change;
            on |= fabs(change) > 1e-9 * (fabs(a[i]) + fabs(d[i]));
        }
        if (!on) break;
    }
    for (i = 0; i < BLOCK; ++i) {
        const double m = a[i] + 0.5 * d[i], mm = m * m + 0.25 * d[i] * d[i];
        a[i] += d[i];
        b[i] -= h * (m + m * mm);
    }
}
static void steps(long n) {
    long k;
    int i;
    for (k = 0; k < n; ++k)
        for (i = 0; i < COUNT; i += BLOCK) block(q + i, p + i);
}
static int look(double *out) {
    out[0] = q[0], out[1] = p[0];
    return 2;
}
#include "bench_main.h"
