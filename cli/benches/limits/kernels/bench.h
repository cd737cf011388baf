/* What all timed programs share. A program defines
     void begin(int size);          puts all at its start
     void steps(long n);            goes n steps on
     int look(double *out);         what it came to, for the comparison: how many numbers
   and then includes `bench_main.h`. It is called as
     PROGRAM check STEPS SIZE       prints what it comes to after so many steps from the start
     PROGRAM run STEPS REPS SIZE    prints the median time of so many steps, ns of one thread's processor time */
#ifndef BENCH_H
#define BENCH_H
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static void begin(int size);
static void steps(long n);
static int look(double *out);

static double nanoseconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

/* The ledger of a region as a tight loop keeps it: plain sums, the worst balance against what the step turned over. */
typedef struct {
    double h, supplied, dissipated, residual, worst, largest;
} ledger;

static inline void book(ledger *l, double h, double supplied, double dissipated) {
    const double turnover = fabs(supplied) + fabs(dissipated);
    const double off = (h - l->h) - (supplied - dissipated);
    double scale = h > l->h ? h : l->h;
    scale = turnover > scale ? turnover : scale;
    l->h = h;
    l->supplied += supplied;
    l->dissipated += dissipated;
    l->residual += off;
    l->largest = h > l->largest ? h : l->largest;
    if (fabs(off) > l->worst * scale) l->worst = fabs(off) / scale;
}
#endif
