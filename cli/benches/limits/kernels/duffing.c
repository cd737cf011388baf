/* H = p^2/2 + q^2/2 + q^4/4, h = 0.05 s, from q = 1: a discrete gradient a storage, and the ledger.
   With m = q + d/2 the difference quotient of the potential is m + m (m^2 + d^2/4), that of p^2/2 is the mean of p, and
   d = h (p - h/2 (m + m^3 + m d^2/4)) is one equation for the change d of q. */
#include "bench.h"

static const double h = 0.05;
static double q, p;
static ledger l;

static void begin(int size) {
    (void)size;
    q = 1.0, p = 0.0;
    memset(&l, 0, sizeof l);
    l.h = 0.75;
}
static void steps(long n) {
    double a = q, b = p, d;
    ledger s = l;
    const double half = 0.5 * h * h;
    long k;
    for (k = 0; k < n; ++k) {
        const double first = half * (0.5 + 1.5 * a * a), way = h * b - half * (a + a * a * a);
        double change, force, m, mm;
        int i;
        /* From the tangent at the start, whose slope is 1 + first, with first far below 1: then one division is enough. */
        d = way * (1.0 - first + first * first);
        m = a + 0.5 * d, mm = m * m + 0.25 * d * d;
        d += (h * b - d - half * (m + m * mm)) * (1.0 - first + first * first);
        for (i = 0; i < 50; ++i) {
            m = a + 0.5 * d, mm = m * m + 0.25 * d * d;
            change = (h * b - d - half * (m + m * mm)) / (1.0 + half * (0.5 + 0.5 * mm + m * (m + 0.5 * d)));
            d += change;
            if (fabs(change) <= 1e-9 * (fabs(a) + fabs(d))) break;
        }
        m = a + 0.5 * d, mm = m * m + 0.25 * d * d;
        force = m + m * mm;
        a += d;
        b -= h * force;
        book(&s, 0.5 * b * b + a * a * (0.5 + 0.25 * a * a), 0.0, 0.0);
    }
    q = a, p = b, l = s;
}
static int look(double *out) {
    out[0] = q, out[1] = p;
    return 2;
}
#include "bench_main.h"
