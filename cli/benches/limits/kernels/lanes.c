/* The ladder of `ladder.c` in eight blocks, one in each lane of a vector. Each block is solved by itself, with 0 beyond its ends; what
   its neighbours change in it are multiples of two vectors made once (the spikes), and the 16 values at the ends of blocks follow from a
   matrix made once. */
#include "bench.h"

enum { LANES = 8, ENDS = 2 * LANES };
typedef double lanes __attribute__((vector_size(8 * LANES)));
static const double h = 1e-3, part = 0.01, load = 1.0, u = 1.0;
static int n;
static lanes *cur, *vol, *y, *pivot, *left, *right;
static double ends[ENDS][ENDS] __attribute__((aligned(64)));

static lanes *room(int count) {
    void *at = 0;
    if (posix_memalign(&at, 64, (size_t)count * sizeof(lanes))) exit(1);
    memset(at, 0, (size_t)count * sizeof(lanes));
    return at;
}
/* Solves all blocks in place. */
static void blocks(lanes *r) {
    lanes z = {0};
    int j;
    const double g = h / (2 * part);
    r[0] *= pivot[0];
    for (j = 1; j < n; ++j) r[j] = (r[j] + g * r[j - 1]) * pivot[j];
    for (j = n - 1; j >= 0; --j) r[j] = z = r[j] + g * pivot[j] * z;
}
static void begin(int size) {
    const double a = 2 * part / h, g = 1.0 / a;
    double m[ENDS][2 * ENDS];
    int b, i, j, k;
    lanes d = {0};
    n = size / LANES;
    if (size % LANES) exit(2);
    cur = room(n + 1), vol = room(n), y = room(n), pivot = room(n), left = room(n), right = room(n);
    for (j = 0; j < n; ++j) {
        for (b = 0; b < LANES; ++b) {
            d[b] = a + 2 * g - (j == 0 ? 0.0 : g * g / d[b]) + (b == LANES - 1 && j == n - 1 ? 1.0 / load - g : 0.0);
            pivot[j][b] = 1.0 / d[b];
            vol[j][b] = 0.1 * sin(b * n + j + 1);
        }
    }
    for (b = 0; b < LANES; ++b) left[0][b] = g, right[n - 1][b] = g;
    blocks(left), blocks(right);
    /* First and last values of the blocks: g = (1 - S) z. */
    memset(m, 0, sizeof m);
    for (b = 0; b < LANES; ++b) {
        for (i = 0; i < 2; ++i) {
            const int at = i * (n - 1), row = i * LANES + b;
            m[row][row] = 1.0;
            m[row][ENDS + row] = 1.0;
            if (b > 0) m[row][LANES + b - 1] = -left[at][b];
            if (b < LANES - 1) m[row][b + 1] = -right[at][b];
        }
    }
    for (k = 0; k < ENDS; ++k) {
        int best = k;
        for (i = k; i < ENDS; ++i) best = fabs(m[i][k]) > fabs(m[best][k]) ? i : best;
        for (j = 0; j < 2 * ENDS; ++j) {
            const double t = m[k][j];
            m[k][j] = m[best][j], m[best][j] = t;
        }
        for (i = 0; i < ENDS; ++i) {
            const double f = i == k ? 1.0 - 1.0 / m[k][k] : m[i][k] / m[k][k];
            for (j = 0; j < 2 * ENDS; ++j) m[i][j] -= f * m[k][j];
        }
    }
    /* By columns, so that a product is a sum of vectors. */
    for (i = 0; i < ENDS; ++i)
        for (j = 0; j < ENDS; ++j) ends[j][i] = m[i][ENDS + j];
}
static void steps(long count) {
    const double a = 2 * part / h, g = 1.0 / a;
    long k;
    for (k = 0; k < count; ++k) {
        const lanes *column = (const lanes *)ends;
        lanes r = {u}, z = {0}, first = {0}, last = {0}, before = {0}, after = {0}, past;
        int j, b;
        /* Beyond a block's last cell is the next block's first; beyond the last block nothing flows that z does not say. */
        for (b = 0; b < LANES; ++b) cur[n][b] = b < LANES - 1 ? cur[0][b + 1] : 0.0;
        for (j = 0; j < n; ++j) {
            r = (a * vol[j] + (cur[j] - cur[j + 1])) * pivot[j] + r * (g * pivot[j]);
            y[j] = r;
        }
        for (j = n - 1; j >= 0; --j) y[j] = z = y[j] + z * (g * pivot[j]);
        for (b = 0; b < LANES; ++b) {
            first += column[2 * b] * y[0][b] + column[2 * (LANES + b)] * y[n - 1][b];
            last += column[2 * b + 1] * y[0][b] + column[2 * (LANES + b) + 1] * y[n - 1][b];
        }
        for (b = 1; b < LANES; ++b) before[b] = last[b - 1], after[b - 1] = first[b];
        past = before;
        past[0] = u;
        for (j = 0; j < n; ++j) {
            z = y[j] + left[j] * before + right[j] * after;
            vol[j] = 2.0 * z - vol[j];
            cur[j] += 2.0 * g * (past - z);
            past = z;
        }
    }
}
static int look(double *out) {
    out[0] = part * cur[0][0], out[1] = part * vol[n - 1][LANES - 1];
    return 2;
}
#include "bench_main.h"
