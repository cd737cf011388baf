/* Mass 1 kg, spring 100 N/m, damper 0.5 N*s/m under 1 N, h = 1 ms: the exact step, the mean speed over it, and the ledger.
   With w = (q, p, 1): w+ = E w, mean speed = c w, lost = w^T Q w, all made once. */
#include "bench.h"

static const double h = 1e-3, k = 100.0, b = 0.5, force = 1.0;
static double e[2][3], c[3], lost[6];
static double q, p, mean;
static ledger l;

/* Rows q and p of exp(A s), and of its integral from 0 to s, by Taylor series. */
static void flow(double s, double out[2][3], double sum[2][3]) {
    static const double a[2][3] = {{0, 1, 0}, {-100.0, -0.5, 1}};
    int i, j, n;
    for (j = 0; j < 3; ++j) {
        long double x[2] = {j == 0, j == 1}, one = j == 2, at[2] = {x[0], x[1]}, integral[2] = {x[0] * s, x[1] * s};
        for (n = 1; n < 30; ++n) {
            long double y[2];
            for (i = 0; i < 2; ++i) y[i] = (a[i][0] * x[0] + a[i][1] * x[1] + a[i][2] * one) * s / n;
            one = 0;
            for (i = 0; i < 2; ++i) x[i] = y[i], at[i] += y[i], integral[i] += y[i] * s / (n + 1);
        }
        for (i = 0; i < 2; ++i) out[i][j] = (double)at[i], sum[i][j] = (double)integral[i];
    }
}
static void begin(int size) {
    /* Gauss-Legendre on four nodes: a speed is a polynomial of degree 2 in so short a step, to rounding. */
    static const double x[4] = {0.06943184420297371, 0.33000947820757187, 0.66999052179242813, 0.93056815579702629};
    static const double w[4] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693};
    double r[2][3], sum[2][3];
    int i;
    (void)size;
    memset(lost, 0, sizeof lost);
    for (i = 0; i < 4; ++i) {
        const double g = b * h * w[i];
        flow(h * x[i], r, sum);
        lost[0] += g * r[1][0] * r[1][0], lost[1] += g * r[1][1] * r[1][1], lost[2] += g * r[1][2] * r[1][2];
        lost[3] += 2 * g * r[1][0] * r[1][1], lost[4] += 2 * g * r[1][0] * r[1][2], lost[5] += 2 * g * r[1][1] * r[1][2];
    }
    flow(h, e, sum);
    for (i = 0; i < 3; ++i) c[i] = sum[1][i] / h;
    q = 0.1, p = 0.0, mean = 0.0;
    memset(&l, 0, sizeof l);
    l.h = 0.5 * k * q * q;
}
static void steps(long n) {
    double x = q, y = p, v = mean;
    ledger s = l;
    long i;
    for (i = 0; i < n; ++i) {
        const double loss = lost[2] + x * (lost[0] * x + lost[3] * y + lost[4]) + y * (lost[1] * y + lost[5]);
        const double next = e[0][0] * x + (e[0][1] * y + e[0][2]);
        v = c[0] * x + (c[1] * y + c[2]);
        y = e[1][0] * x + (e[1][1] * y + e[1][2]);
        x = next;
        book(&s, 0.5 * (k * x * x + y * y), force * (h * v), loss);
    }
    q = x, p = y, mean = v, l = s;
}
static int look(double *out) {
    out[0] = q, out[1] = p;
    return 2;
}
#include "bench_main.h"
