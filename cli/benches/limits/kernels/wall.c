/* A handle of 1 kg pushed by 5 N against a wall that is sampled at 25 Hz: spring 1000 N/m, damper 30 N*s/m, 0.1 m away. The force over
   an interval is the one that the wall, stepped with its discrete gradient, answers to the motion which that force lets happen, as foretold
   from the samples; no more energy is given back than was put in; both sides have a ledger. SIZE 1 pulls for 5 samples of every 30. */
#include "bench.h"

static const double T = 0.04, K = 1000.0, B = 30.0;
static int pulling;
static long sample;
static double p, x, held, alpha[2], before[2], tank, leaked, debt;
static ledger hand, wall;

static inline double stored(double q) { return q > 0.0 ? 0.5 * K * q * q : 0.0; }

/* The wall's mean force over a move of d, and its slope. */
static inline double law(double q, double d, double *slope) {
    const double end = q + d, mid = q + 0.5 * d;
    double e, s;
    if (q > 0.0 && end > 0.0) {
        e = K * mid, s = 0.5 * K;
    } else if (q <= 0.0 && end <= 0.0) {
        return *slope = 0.0;
    } else {
        const double w = 1.0 / d;
        e = (stored(end) - stored(q)) * w;
        s = ((end > 0.0 ? K * end : 0.0) - e) * w;
    }
    if (mid > 0.0) e += (B / T) * d, s += B / T;
    *slope = s;
    return e;
}
/* The force that answers d = free - beta force. */
static inline double answer(double q, double free, double beta, double d) {
    double slope, e, low, high;
    int i;
    for (i = 0; i < 50; ++i) {
        double change;
        e = law(q, d, &slope);
        change = (free - beta * e - d) / (1.0 + beta * slope);
        d += change;
        if (fabs(change) <= 1e-9 * (fabs(q) + fabs(d))) return law(q, d, &slope);
    }
    /* A damper that lets go within the interval leaves no answer: the force on its jump, by bisection. */
    e = law(q, free, &slope);
    if (e == 0.0) return e;
    low = fmin(free, free - beta * e), high = fmax(free, free - beta * e);
    for (i = 0; i < 100; ++i) {
        d = 0.5 * (low + high);
        if (d <= low || d >= high) break;
        e = law(q, d, &slope);
        if (d - free + beta * e > 0.0) high = d;
        else low = d;
    }
    return (free - d) / beta;
}
static void begin(int size) {
    pulling = size == 1, sample = 0;
    p = held = 0.0, x = -0.1;
    alpha[0] = alpha[1] = before[0] = before[1] = tank = leaked = debt = 0.0;
    memset(&hand, 0, sizeof hand);
    memset(&wall, 0, sizeof wall);
}
static void steps(long n) {
    const double beta = 0.5 * T * T;
    long k;
    for (k = 0; k < n; ++k, ++sample) {
        const double push = pulling && sample % 30 >= 25 ? -5.0 : 5.0, net = push - held;
        const double q = T * p + 0.5 * T * T * net;
        double slope, e, lost, leak, free, v, given, room;
        p += T * net;
        book(&hand, 0.5 * p * p, push * q - held * q, 0.0);
        /* The wall's own step, and what the held force let cross beyond it. */
        e = law(x, q, &slope);
        lost = x + 0.5 * q > 0.0 ? (B / T) * q * q : 0.0;
        x += q;
        book(&wall, stored(x), e * q, lost);
        leak = e * q - held * q;
        leaked += leak;
        wall.supplied -= leak;
        tank += lost - leak;
        tank = tank > wall.largest ? wall.largest : tank;
        debt = -(wall.h + tank) > debt ? -(wall.h + tank) : debt;
        /* The next interval foretold. */
        alpha[1] = alpha[0], alpha[0] = q + beta * held;
        before[1] = before[0], before[0] = held;
        free = alpha[0] - 2.0 * beta * (before[0] - before[1]) + (sample > 0 ? alpha[0] - alpha[1] : 0.0);
        v = answer(x, free, beta, q);
        given = v * free - beta * v * v;
        room = wall.h + tank > 0.0 ? wall.h + tank : 0.0;
        if (given < -room) {
            double s = (v * free + sqrt(v * free * (v * free) + 4.0 * beta * v * v * room)) / (2.0 * beta * v * v);
            v *= s >= 0.0 ? (s <= 1.0 ? s : 1.0) : 0.0;
        }
        held = v;
    }
}
static int look(double *out) {
    out[0] = x, out[1] = p, out[2] = held;
    return 3;
}
#include "bench_main.h"
