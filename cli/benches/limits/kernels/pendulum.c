/* Two unit masses on two unit rods, angles from the vertical, from 90 degrees both, h = 2 ms, without ledger.
     H = (p1^2 + 2 p2^2 - 2 p1 p2 cos d)/(2 (1 + sin^2 d)) - g (2 cos q1 + cos q2),   d = q1 - q2
   Gonzalez' discrete gradient: that of the midpoint, and along the change what is missing of the difference of H. Newton's method
   with the whole Jacobian. */
#include "bench.h"

static const double h = 2e-3, g = 9.81;
static double x[4], change[4], older[4]; /* p1, p2, q1, q2; the last change and the one before */

/* Cosines and sines of the two angles. */
typedef struct {
    double c1, s1, c2, s2;
} turn;

static inline turn turned(const double *s) { return (turn){cos(s[2]), sin(s[2]), cos(s[3]), sin(s[3])}; }

/* Where twice the one turn less the other leads: from the middle and the start of a step to its end. */
static inline turn beyond(turn m, turn a) {
    const double c1 = m.c1 * m.c1 - m.s1 * m.s1, s1 = 2.0 * m.s1 * m.c1;
    const double c2 = m.c2 * m.c2 - m.s2 * m.s2, s2 = 2.0 * m.s2 * m.c2;
    return (turn){c1 * a.c1 + s1 * a.s1, s1 * a.c1 - c1 * a.s1, c2 * a.c2 + s2 * a.s2, s2 * a.c2 - c2 * a.s2};
}
/* H and its gradient; and where asked for the second derivatives: p1p1, p1p2, p2p2, p1d, p2d, dd, q1, q2. */
static inline double energy(const double *s, turn a, double *e, double *f) {
    const double c1 = a.c1, s1 = a.s1, c2 = a.c2, s2 = a.s2;
    const double p1 = s[0], p2 = s[1], c = c1 * c2 + s1 * s2, sd = s1 * c2 - c1 * s2, sc = sd * c;
    const double w = 1.0 / (1.0 + sd * sd), n = p1 * p1 + 2.0 * p2 * p2 - 2.0 * p1 * p2 * c, pp = p1 * p2;
    const double e1 = (p1 - p2 * c) * w, e2 = (2.0 * p2 - p1 * c) * w, t = (pp * sd - n * sc * w) * w;
    e[0] = e1, e[1] = e2, e[2] = t + 2.0 * g * s1, e[3] = g * s2 - t;
    if (f) {
        f[0] = w, f[1] = -c * w, f[2] = 2.0 * w;
        f[3] = (p2 * sd - 2.0 * e1 * sc) * w;
        f[4] = (p1 * sd - 2.0 * e2 * sc) * w;
        f[5] = w * (pp * c - w * (4.0 * pp * sd * sc + n * (c * c - sd * sd) - 4.0 * n * sc * sc * w));
        f[6] = 2.0 * g * c1, f[7] = g * c2;
    }
    return 0.5 * n * w - g * (2.0 * c1 + c2);
}
static void begin(int size) {
    (void)size;
    x[0] = x[1] = 0.0, x[2] = x[3] = 1.57079632679489662;
    memset(change, 0, sizeof change);
    memset(older, 0, sizeof older);
}
/* Solves 4 by 4 in place, pivots on the diagonal: the matrix is the unit one and terms of order h. */
static inline void solve(double m[4][4], double *r) {
    int i, j, k;
    for (k = 0; k < 4; ++k) {
        const double w = 1.0 / m[k][k];
        for (i = k + 1; i < 4; ++i) {
            const double t = m[i][k] * w;
            for (j = k + 1; j < 4; ++j) m[i][j] -= t * m[k][j];
            r[i] -= t * r[k];
        }
        m[k][k] = w;
    }
    for (k = 3; k >= 0; --k) {
        for (j = k + 1; j < 4; ++j) r[k] -= m[k][j] * r[j];
        r[k] *= m[k][k];
    }
}
static void steps(long count) {
    double e[4];
    turn start = turned(x);
    double before = energy(x, start, e, 0);
    long k;
    for (k = 0; k < count; ++k) {
        double d[4], after;
        turn half;
        int i, j, round;
        for (i = 0; i < 4; ++i) d[i] = 2.0 * change[i] - older[i];
        for (round = 0; round < 50; ++round) {
            double end[4], mid[4], at[4], ahead[4], f[8], dd = 0.0, miss, over, hess[4][4], m[4][4], r[4], slope[4], most = 0.0;
            for (i = 0; i < 4; ++i) end[i] = x[i] + d[i], mid[i] = x[i] + 0.5 * d[i], dd += d[i] * d[i];
            half = turned(mid);
            energy(mid, half, at, f);
            after = energy(end, beyond(half, start), ahead, 0);
            miss = after - before;
            for (i = 0; i < 4; ++i) miss -= at[i] * d[i];
            over = dd > 1e-30 ? 1.0 / dd : 0.0;
            miss *= over;
            hess[0][0] = f[0], hess[0][1] = hess[1][0] = f[1], hess[1][1] = f[2];
            hess[0][2] = hess[2][0] = f[3], hess[0][3] = hess[3][0] = -f[3];
            hess[1][2] = hess[2][1] = f[4], hess[1][3] = hess[3][1] = -f[4];
            hess[2][2] = f[5] + f[6], hess[2][3] = hess[3][2] = -f[5], hess[3][3] = f[5] + f[7];
            for (i = 0; i < 4; ++i) {
                double sum = 0.0;
                for (j = 0; j < 4; ++j) sum += hess[i][j] * d[j];
                slope[i] = (ahead[i] - at[i] - 0.5 * sum - 2.0 * miss * d[i]) * over;
            }
            for (i = 0; i < 4; ++i) {
                /* dp/dt = -dH/dq, dq/dt = dH/dp */
                const int from = i ^ 2;
                const double s = i < 2 ? -h : h;
                r[i] = s * (at[from] + miss * d[from]) - d[i];
                for (j = 0; j < 4; ++j)
                    m[i][j] = (i == j) - s * (0.5 * hess[from][j] + (j == from ? miss : 0.0) + d[from] * slope[j]);
            }
            solve(m, r);
            for (i = 0; i < 4; ++i) {
                d[i] += r[i];
                most = fmax(most, fabs(r[i]) - 1e-9 * (fabs(x[i]) + fabs(d[i])));
            }
            if (most <= 0.0) break;
        }
        for (i = 0; i < 4; ++i) x[i] += d[i], older[i] = change[i], change[i] = d[i];
        start = turned(x);
        before = energy(x, start, e, 0);
    }
}
static int look(double *out) {
    int i;
    for (i = 0; i < 4; ++i) out[i] = x[i];
    return 4;
}
#include "bench_main.h"
