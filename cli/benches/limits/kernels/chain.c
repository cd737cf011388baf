/* A chain of dependent multiply-adds: what a machine's time is measured against. One step is one link. */
#include "bench.h"

static double x;

static void begin(int size) { x = (double)size; }
static void steps(long n) {
    double y = x;
    long k;
    for (k = 0; k < n; ++k) y = fma(y, 0.999, 0.5);
    x = y;
}
static int look(double *out) {
    out[0] = x;
    return 1;
}
#include "bench_main.h"
