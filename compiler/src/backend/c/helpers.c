/* -- bond_sign */
static bond_real bond_sign(bond_real a) {
    return a > 0 ? BOND_R(1.0) : a < 0 ? BOND_R(-1.0) : a == 0 ? BOND_R(0.0) : a;
}
/* -- bond_min */
static bond_real bond_min(bond_real a, bond_real b) {
    if (a < b) return a;
    if (b < a) return b;
    if (a == b) return a == 0 && 1 / a < 0 ? a : b;
    return a + b;
}
/* -- bond_max */
static bond_real bond_max(bond_real a, bond_real b) {
    if (a > b) return a;
    if (b > a) return b;
    if (a == b) return a == 0 && 1 / a < 0 ? b : a;
    return a + b;
}
/* -- bond_pick */
#ifndef BOND_SIMD /* whether vectors of four numbers and more are there; else lanes go one by one */
#if defined(__AVX2__) || defined(__ARM_FEATURE_SVE) || defined(__riscv_vector)
#define BOND_SIMD 1
#else
#define BOND_SIMD 0
#endif
#endif
#if BOND_SIMD
/* Conditions of lanes are all bits or none, and numbers are chosen bit by bit: where nothing branches, compilers find vectors. */
#include <stdint.h>
#ifdef BOND_FLOAT
typedef int32_t bond_mask;
#else
typedef int64_t bond_mask;
#endif
#define BOND_IF(c) (-(bond_mask)(c))
/* Not every scene takes all of these. */
#ifdef __GNUC__
#define BOND_SPARE __attribute__((unused)) static inline
#else
#define BOND_SPARE static inline
#endif
BOND_SPARE bond_real bond_pick(bond_mask c, bond_real a, bond_real b) {
    union {
        bond_real x;
        bond_mask bits;
    } p, q;
    p.x = a;
    q.x = b;
    p.bits = (p.bits & c) | (q.bits & ~c);
    return p.x;
}
#endif
/* -- bond_lane_sign */
#if BOND_SIMD
BOND_SPARE bond_real bond_lane_sign(bond_real a) {
    const bond_real other = bond_pick(BOND_IF(a == 0), BOND_R(0.0), a);
    return bond_pick(BOND_IF(a > 0), BOND_R(1.0), bond_pick(BOND_IF(a < 0), BOND_R(-1.0), other));
}
#endif
/* -- bond_lane_min */
#if BOND_SIMD
BOND_SPARE bond_real bond_lane_min(bond_real a, bond_real b) {
    const bond_real same = bond_pick(BOND_IF(BOND_M(copysign)(BOND_R(1.0), a) < 0), a, b);
    const bond_real other = bond_pick(BOND_IF(a == b), same, a + b);
    return bond_pick(BOND_IF(a < b), a, bond_pick(BOND_IF(b < a), b, other));
}
#endif
/* -- bond_lane_max */
#if BOND_SIMD
BOND_SPARE bond_real bond_lane_max(bond_real a, bond_real b) {
    const bond_real same = bond_pick(BOND_IF(BOND_M(copysign)(BOND_R(1.0), a) < 0), b, a);
    const bond_real other = bond_pick(BOND_IF(a == b), same, a + b);
    return bond_pick(BOND_IF(a > b), a, bond_pick(BOND_IF(b > a), b, other));
}
#endif
/* -- bond_place */
/* A whole number below n; 0 for any other. */
static unsigned long bond_place(bond_real k, unsigned long n) {
    return k >= 0 && k < (bond_real)n ? (unsigned long)k : 0;
}
/* -- bond_scale */
/* A power of two near 1 / x. */
static bond_real bond_scale(bond_real x) {
    int e;
    if (x == 0 || !(x < BOND_INFINITY)) return 1;
    (void)BOND_M(frexp)(x, &e);
    e = 1 - e;
    if (e > BOND_EXPONENT) e = BOND_EXPONENT;
    if (e < -BOND_EXPONENT) e = -BOND_EXPONENT;
    return BOND_M(ldexp)(BOND_R(1.0), e);
}
/* -- bond_line */
/* A pattern: pivots by row and column, entries by step of their row, and both factors, row by row. */
struct bond_pattern {
    unsigned long n, lower, upper;
    const unsigned *row, *column, *starts, *entries, *lower_starts, *lower_columns, *upper_starts, *upper_columns;
};
/* The factors with fixed pivots, in w; they have the scales, powers of two, in them. -1, or the row without a pivot. */
static bond_real bond_factor(const struct bond_pattern *p, const bond_real *values, bond_real *w) {
    const unsigned long n = p->n;
    bond_real *lower = w, *upper = lower + p->lower, *inverse = upper + p->upper, *rows = inverse + n;
    bond_real *columns = rows + n, *work = columns + n, *grown = work + 2 * n, growth = 0;
    unsigned long i, k, m;
    *grown = -1;
    for (i = 0; i < n; ++i) work[i] = 0;
    for (i = 0; i < n; ++i) {
        bond_real largest = 0;
        for (k = p->starts[i]; k < p->starts[i + 1]; ++k) {
            const bond_real x = BOND_M(fabs)(values[p->entries[2 * k]]);
            if (x > largest) largest = x;
        }
        rows[i] = bond_scale(largest);
        for (k = p->starts[i]; k < p->starts[i + 1]; ++k) {
            const bond_real x = BOND_M(fabs)(values[p->entries[2 * k]] * rows[i]);
            if (x > work[p->entries[2 * k + 1]]) work[p->entries[2 * k + 1]] = x;
        }
    }
    for (i = 0; i < n; ++i) {
        columns[i] = bond_scale(work[i]);
        work[i] = 0;
    }
    for (i = 0; i < n; ++i) {
        bond_real own, pivot, reciprocal;
        for (k = p->starts[i]; k < p->starts[i + 1]; ++k) {
            const unsigned c = p->entries[2 * k + 1];
            work[c] = values[p->entries[2 * k]] * rows[i] * columns[c];
        }
        own = BOND_M(fabs)(work[i]);
        for (k = p->lower_starts[i]; k < p->lower_starts[i + 1]; ++k) {
            const unsigned c = p->lower_columns[k];
            const bond_real l = work[c] * inverse[c];
            work[c] = 0;
            lower[k] = l;
            if (l == 0) continue;
            if (BOND_M(fabs)(l) > growth) {
                growth = BOND_M(fabs)(l);
                if (growth > BOND_R(1.0) / BOND_SMALL(1e-13, 1e-6)) return (bond_real)p->row[c];
            }
            for (m = p->upper_starts[c]; m < p->upper_starts[c + 1]; ++m) work[p->upper_columns[m]] -= l * upper[m];
        }
        pivot = work[i];
        reciprocal = 1 / pivot;
        if (!(BOND_M(fabs)(reciprocal) < BOND_INFINITY) || !(BOND_M(fabs)(pivot) < BOND_INFINITY)
            || BOND_M(fabs)(pivot) < BOND_SMALL(1e-15, 1e-6) * own) return (bond_real)p->row[i];
        inverse[i] = reciprocal;
        work[i] = 0;
        for (k = p->upper_starts[i]; k < p->upper_starts[i + 1]; ++k) {
            upper[k] = work[p->upper_columns[k]];
            work[p->upper_columns[k]] = 0;
        }
    }
    for (i = 0; i < n; ++i) {
        for (k = p->lower_starts[i]; k < p->lower_starts[i + 1]; ++k)
            if (lower[k] != 0) lower[k] *= rows[p->lower_columns[k]] / rows[i];
        for (k = p->upper_starts[i]; k < p->upper_starts[i + 1]; ++k)
            if (upper[k] != 0) upper[k] = upper[k] * inverse[i] * (columns[i] / columns[p->upper_columns[k]]);
        inverse[i] = inverse[i] * rows[i] * columns[i];
    }
    *grown = growth;
    return -1;
}
/* Takes off a right side what a solution makes of it. */
static void bond_leave(const struct bond_pattern *p, const bond_real *values, const bond_real *x, bond_real *rest) {
    unsigned long i, k;
    for (i = 0; i < p->n; ++i) {
        bond_real sum = rest[p->row[i]];
        for (k = p->starts[i]; k < p->starts[i + 1]; ++k)
            sum -= values[p->entries[2 * k]] * x[p->column[p->entries[2 * k + 1]]];
        rest[p->row[i]] = sum;
    }
}
/* A line of unknowns 0, 1, 2, ..., each joined to the next: the outer ones, 0, 2, ..., are eliminated first, then the middle ones, 1,
   5, ..., then the inner ones, 3, 7, ..., from both ends in turn. At which step an unknown is: */
static unsigned long bond_line_step(unsigned long n, unsigned long unknown) {
    const unsigned long k = unknown / 4, end = n / 4 - 1;
    switch (unknown % 4) {
        case 1: return n - n / 2 + k;
        case 3: return n - 1 - end + (2 * k <= end ? 2 * k : 2 * (end - k) + 1);
        default: return unknown / 2;
    }
}
/* What a factor has of an unknown in the row of another; nothing of those beyond the ends. */
static bond_real bond_line_entry(unsigned long n, const unsigned *starts, const unsigned *columns, const bond_real *values,
                                 unsigned long row, unsigned long unknown) {
    unsigned long k;
    if (unknown >= n) return 0;
    row = bond_line_step(n, row);
    for (k = starts[row]; k < starts[row + 1]; ++k)
        if (columns[k] == bond_line_step(n, unknown)) return values[k];
    return 0;
}
/* Factors in the order in which a substitution comes by four unknowns of each end: first all that it takes on the way down. Unknowns
   are counted from the inner one towards the middle. */
static void bond_line_pack(const struct bond_pattern *p, const bond_real *lower, const bond_real *upper, const bond_real *inverse,
                           bond_real *down) {
    static const short less[][2] = { { 2, 1 }, { 2, 3 }, { 0, -1 }, { 0, 1 }, { 0, -2 }, { 0, 2 }, { 0, -4 } };
    static const short find[][2] = { { 0, 0 }, { 0, 4 }, { 2, 2 }, { 2, 4 }, { 2, 0 }, { 1, 1 },
                                     { 1, 0 }, { 1, 2 }, { 3, 3 }, { 3, 4 }, { 3, 2 } };
    const unsigned long n = p->n, inner = n / 4, pairs = (inner - 1) / 2;
    bond_real *up = down + 14 * pairs;
    unsigned long pair, k;
    for (pair = 0; pair < pairs; ++pair) {
        const unsigned long a = 4 * pair + 3, c = 4 * (inner - pair) - 1;
        for (k = 0; k < 7; ++k) {
            const unsigned long row = (unsigned long)less[k][0], other = (unsigned long)less[k][1];
            *down++ = bond_line_entry(n, p->lower_starts, p->lower_columns, lower, a + row, a + other);
            *down++ = bond_line_entry(n, p->lower_starts, p->lower_columns, lower, c - row, c - other);
        }
        for (k = 0; k < 11; ++k) {
            const unsigned long row = (unsigned long)find[k][0], other = (unsigned long)find[k][1];
            if (row == other) {
                *up++ = inverse[bond_line_step(n, a + row)], *up++ = inverse[bond_line_step(n, c - row)];
            } else {
                *up++ = bond_line_entry(n, p->upper_starts, p->upper_columns, upper, a + row, a + other);
                *up++ = bond_line_entry(n, p->upper_starts, p->upper_columns, upper, c - row, c - other);
            }
        }
    }
}
/* What is left of a right side in the row of an unknown. */
static void bond_line_less(const struct bond_pattern *p, const bond_real *lower, bond_real *b, unsigned long unknown) {
    const unsigned long step = bond_line_step(p->n, unknown);
    bond_real sum = b[unknown];
    unsigned long k;
    for (k = p->lower_starts[step]; k < p->lower_starts[step + 1]; ++k) sum -= lower[k] * b[p->column[p->lower_columns[k]]];
    b[unknown] = sum;
}
/* An unknown, from those that are eliminated after it. */
static void bond_line_find(const struct bond_pattern *p, const bond_real *upper, const bond_real *inverse, bond_real *b,
                           unsigned long unknown) {
    const unsigned long step = bond_line_step(p->n, unknown);
    bond_real sum = b[unknown] * inverse[step];
    unsigned long k;
    for (k = p->upper_starts[step]; k < p->upper_starts[step + 1]; ++k) sum -= upper[k] * b[p->column[p->upper_columns[k]]];
    b[unknown] = sum;
}
/* A number of the left end and one of the right, for which one instruction does the same where the compiler has words for that. */
#ifdef __GNUC__
typedef bond_real bond_two __attribute__((vector_size(2 * sizeof(bond_real))));
static bond_two bond_two_of(bond_real x, bond_real y) { return (bond_two){ x, y }; }
static bond_real bond_two_at(bond_two x, int i) { return x[i]; }
static bond_two bond_two_times(bond_two x, bond_two y) { return x * y; }
static bond_two bond_two_less(bond_two x, bond_two a, bond_two y) { return x - a * y; }
#else
typedef struct { bond_real x[2]; } bond_two;
static bond_two bond_two_of(bond_real x, bond_real y) {
    bond_two z;
    z.x[0] = x, z.x[1] = y;
    return z;
}
static bond_real bond_two_at(bond_two x, int i) { return x.x[i]; }
static bond_two bond_two_times(bond_two x, bond_two y) { return bond_two_of(x.x[0] * y.x[0], x.x[1] * y.x[1]); }
static bond_two bond_two_less(bond_two x, bond_two a, bond_two y) {
    return bond_two_of(x.x[0] - a.x[0] * y.x[0], x.x[1] - a.x[1] * y.x[1]);
}
#endif
/* The k-th pair of packed factors. */
static bond_two bond_two_packed(const bond_real *packed, int k) { return bond_two_of(packed[2 * k], packed[2 * k + 1]); }
/* The k-th of four unknowns of each end, counted from the inner one towards the middle, and back. */
static bond_two bond_two_get(const bond_real *left, const bond_real *right, int k) { return bond_two_of(left[k], right[3 - k]); }
static void bond_two_put(bond_real *left, bond_real *right, int k, bond_two x) {
    left[k] = bond_two_at(x, 0), right[3 - k] = bond_two_at(x, 1);
}
/* A right side becomes the solution. */
static void bond_line_substitute(const struct bond_pattern *p, const bond_real *restrict lower, const bond_real *restrict upper,
                                 const bond_real *restrict inverse, const bond_real *restrict packed, bond_real *restrict b) {
    static const unsigned short ends[] = { 1, 0, 2 }, down[] = { 2, 0, 4 }, up[] = { 4, 0, 2, 1, 3 };
    const unsigned long n = p->n, inner = n / 4, pairs = (inner - 1) / 2, end = 4 * inner, between = 4 * pairs + 3;
    const unsigned long odd = inner % 2;
    bond_two chain = bond_two_of(0, 0), old_outer, old_middle;
    bond_real *l, *r;
    unsigned long k;
    bond_line_less(p, lower, b, 1);
    if (end + 1 < n) bond_line_less(p, lower, b, end + 1);
    old_outer = bond_two_of(b[2], end < n ? b[end] : 0);
    old_middle = bond_two_of(b[1], end + 1 < n ? b[end + 1] : 0);
    for (k = 0, l = b + 3, r = b + end - 4; k < pairs; ++k, l += 4, r -= 4, packed += 14) {
        const bond_two outer = bond_two_get(l, r, 1), new_outer = bond_two_get(l, r, 3);
        bond_two middle = bond_two_less(bond_two_get(l, r, 2), bond_two_packed(packed, 0), outer);
        middle = bond_two_less(middle, bond_two_packed(packed, 1), new_outer);
        old_outer = bond_two_less(bond_two_get(l, r, 0), bond_two_packed(packed, 2), old_outer);
        old_outer = bond_two_less(old_outer, bond_two_packed(packed, 3), outer);
        old_middle = bond_two_less(old_outer, bond_two_packed(packed, 4), old_middle);
        old_middle = bond_two_less(old_middle, bond_two_packed(packed, 5), middle);
        chain = bond_two_less(old_middle, bond_two_packed(packed, 6), chain);
        old_outer = new_outer, old_middle = middle;
        bond_two_put(l, r, 0, chain);
        bond_two_put(l, r, 2, middle);
    }
    for (k = 0; k < 3 - 2 * odd; ++k) bond_line_less(p, lower, b, between + (odd ? 0 : down[k]));
    for (k = 0; k < 5 - 4 * odd; ++k) bond_line_find(p, upper, inverse, b, between + (odd ? 0 : up[k]));
    chain = bond_two_of(b[between], b[end - between + 2]);
    for (k = 0, packed += 22 * pairs; k < pairs; ++k) {
        bond_two x, middle, far, near;
        l -= 4, r += 4, packed -= 22;
        x = bond_two_times(bond_two_get(l, r, 0), bond_two_packed(packed, 0));
        x = bond_two_less(x, bond_two_packed(packed, 1), chain);
        middle = bond_two_times(bond_two_get(l, r, 2), bond_two_packed(packed, 2));
        middle = bond_two_less(middle, bond_two_packed(packed, 3), chain);
        middle = bond_two_less(middle, bond_two_packed(packed, 4), x);
        far = bond_two_times(bond_two_get(l, r, 1), bond_two_packed(packed, 5));
        far = bond_two_less(far, bond_two_packed(packed, 6), x);
        far = bond_two_less(far, bond_two_packed(packed, 7), middle);
        near = bond_two_times(bond_two_get(l, r, 3), bond_two_packed(packed, 8));
        near = bond_two_less(near, bond_two_packed(packed, 9), chain);
        near = bond_two_less(near, bond_two_packed(packed, 10), middle);
        chain = x;
        bond_two_put(l, r, 0, x);
        bond_two_put(l, r, 1, far);
        bond_two_put(l, r, 2, middle);
        bond_two_put(l, r, 3, near);
    }
    for (k = 0; k < 3; ++k) bond_line_find(p, upper, inverse, b, ends[k]);
    for (k = 0; k < 3; ++k)
        if (end + ends[k] < n) bond_line_find(p, upper, inverse, b, end + ends[k]);
}
/* Elimination, and one step of refinement where it was not plainly stable; the factors are those in w where the values are the
   same as before. -1, or the row without a pivot. */
static bond_real bond_line(const struct bond_pattern *p, const bond_real *values, bond_real *b, bond_real *w, int same) {
    const unsigned long n = p->n;
    bond_real *lower = w, *upper = lower + p->lower, *inverse = upper + p->upper;
    bond_real *rest = inverse + 4 * n, *grown = rest + n, *packed = grown + 1;
    int again;
    unsigned long i;
    if (!same || *grown < 0) {
        const bond_real failed = bond_factor(p, values, w);
        if (!(failed < 0)) return failed;
        bond_line_pack(p, lower, upper, inverse, packed);
    }
    again = *grown > BOND_R(1e3);
    if (again)
        for (i = 0; i < n; ++i) rest[i] = b[i];
    bond_line_substitute(p, lower, upper, inverse, packed, b);
    if (again) {
        bond_leave(p, values, b, rest);
        bond_line_substitute(p, lower, upper, inverse, packed, rest);
        for (i = 0; i < n; ++i) b[i] += rest[i];
    }
    return -1;
}
