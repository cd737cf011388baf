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
/* -- bond_dense */
/* Gauss' elimination with scaled partial pivoting; w has room for n n + 4 n numbers. -1, or the row without a pivot. */
static bond_real bond_dense(unsigned long n, const unsigned short *at, unsigned long count, const bond_real *values,
                            bond_real *b, bond_real *w) {
    bond_real *a = w, *column = w + n * n, *scale = column + n, *inverse = scale + n, *order = inverse + n;
    unsigned long i, j, k, p;
    for (k = 0; k < n * n; ++k) a[k] = 0;
    for (k = 0; k < count; ++k) a[at[2 * k] * n + at[2 * k + 1]] = values[k];
    for (j = 0; j < n; ++j) column[j] = 0;
    for (i = 0; i < n; ++i) {
        bond_real largest = 0;
        for (j = 0; j < n; ++j) {
            const bond_real x = BOND_M(fabs)(a[i * n + j]);
            if (x > largest) largest = x;
        }
        if (largest == 0) return (bond_real)i;
        order[i] = (bond_real)i;
        scale[i] = 1 / largest;
        for (j = 0; j < n; ++j) {
            const bond_real x = BOND_M(fabs)(a[i * n + j]) * scale[i];
            if (x > column[j]) column[j] = x;
        }
    }
    for (k = 0; k < n; ++k) {
        bond_real best = BOND_M(fabs)(a[k * n + k]) * scale[k];
        p = k;
        for (i = k + 1; i < n; ++i) {
            const bond_real size = BOND_M(fabs)(a[i * n + k]) * scale[i];
            if (size > best) {
                p = i;
                best = size;
            }
        }
        if (best <= BOND_SMALL(1e-16, 1e-7) * column[k]) return order[k];
        if (p > k) {
            bond_real x;
            for (j = k; j < n; ++j) {
                x = a[k * n + j];
                a[k * n + j] = a[p * n + j];
                a[p * n + j] = x;
            }
            x = b[k], b[k] = b[p], b[p] = x;
            x = order[k], order[k] = order[p], order[p] = x;
            x = scale[k], scale[k] = scale[p], scale[p] = x;
        }
        inverse[k] = 1 / a[k * n + k];
        for (i = k + 1; i < n; ++i) {
            const bond_real l = a[i * n + k] * inverse[k];
            for (j = k + 1; j < n; ++j) a[i * n + j] -= l * a[k * n + j];
            b[i] -= l * b[k];
        }
    }
    for (k = n; k-- > 0;) {
        bond_real rest = b[k];
        for (j = k + 1; j < n; ++j) rest -= a[k * n + j] * b[j];
        b[k] = rest * inverse[k];
    }
    return -1;
}
/* -- bond_sparse */
/* A pattern: pivots by row and column, entries by step of their row, and both factors, row by row. */
struct bond_pattern {
    unsigned long n, lower, upper;
    const unsigned *row, *column, *starts, *entries, *lower_starts, *lower_columns, *upper_starts, *upper_columns;
};
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
static void bond_substitute(const struct bond_pattern *p, const bond_real *lower, const bond_real *upper,
                            const bond_real *inverse, bond_real *work) {
    unsigned long i, k;
    for (i = 0; i < p->n; ++i) {
        bond_real sum = work[i];
        for (k = p->lower_starts[i]; k < p->lower_starts[i + 1]; ++k) sum -= lower[k] * work[p->lower_columns[k]];
        work[i] = sum;
    }
    for (i = p->n; i-- > 0;) {
        bond_real sum = work[i] * inverse[i];
        for (k = p->upper_starts[i]; k < p->upper_starts[i + 1]; ++k) sum -= upper[k] * work[p->upper_columns[k]];
        work[i] = sum;
    }
}
/* The factors with fixed pivots, in w. -1, or the row without a pivot. */
static bond_real bond_factor(const struct bond_pattern *p, const bond_real *values, bond_real *w) {
    const unsigned long n = p->n;
    bond_real *lower = w, *upper = lower + p->lower, *inverse = upper + p->upper, *rows = inverse + n;
    bond_real *columns = rows + n, *work = columns + n, growth = 0;
    unsigned long i, k, m;
    work[2 * n] = -1;
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
    for (i = 0; i < n; ++i)
        for (k = p->upper_starts[i]; k < p->upper_starts[i + 1]; ++k) upper[k] *= inverse[i];
    work[2 * n] = growth;
    return -1;
}
/* Elimination, and one step of refinement where it was not plainly stable; the factors are those in w where the values are the
   same as before. -1, or the row without a pivot. */
static bond_real bond_sparse(const struct bond_pattern *p, const bond_real *values, bond_real *b, bond_real *w, int same) {
    const unsigned long n = p->n;
    bond_real *lower = w, *upper = lower + p->lower, *inverse = upper + p->upper, *rows = inverse + n;
    bond_real *columns = rows + n, *work = columns + n, *right = work + n;
    const bond_real failed = same && right[n] >= 0 ? -1 : bond_factor(p, values, w);
    unsigned long i, k;
    if (!(failed < 0)) return failed;
    for (i = 0; i < n; ++i) right[i] = work[i] = b[p->row[i]] * rows[i];
    bond_substitute(p, lower, upper, inverse, work);
    for (i = 0; i < n; ++i) b[p->column[i]] = work[i] * columns[i];
    if (right[n] > BOND_R(1e3)) {
        for (i = 0; i < n; ++i) {
            bond_real rest = right[i];
            for (k = p->starts[i]; k < p->starts[i + 1]; ++k)
                rest -= values[p->entries[2 * k]] * rows[i] * b[p->column[p->entries[2 * k + 1]]];
            work[i] = rest;
        }
        bond_substitute(p, lower, upper, inverse, work);
        for (i = 0; i < n; ++i) b[p->column[i]] += work[i] * columns[i];
    }
    return -1;
}
