/* Times a scene that `bond build` emitted, SCENES of it in turn; with PULLS its first input pulls for 5 samples of every 30,
   with RUNS it has a `bond_run`, with BESIDE scenes go side by side, in lanes. */
#include "bench.h"
#include "scene.h"

#ifdef BESIDE
#define ALL ((SCENES + BOND_LANES - 1) / BOND_LANES)
#define COMMIT bond_lanes_commit
static bond_lanes scene[ALL];
#else
#define ALL SCENES
#define COMMIT bond_commit
static bond_state scene[ALL];
#endif
static bond_real moved[BOND_PORTS + 1];
static long sample;

static void begin(int size) {
    int i;
    (void)size;
#ifdef BESIDE
    /* Each is where the one before it will be an interval later, so that they do not do all the same. */
    static bond_state one;
    int l;
    bond_init(&one);
    for (i = 0; i < ALL; ++i) {
        bond_lanes_init(&scene[i]);
        for (l = 0; l < BOND_LANES; ++l) {
            bond_lanes_put(&scene[i], l, &one);
            if (bond_commit(&one, moved)) exit(3);
        }
    }
#else
    for (i = 0; i < ALL; ++i) bond_init(&scene[i]);
#endif
    sample = 0;
}
#if SCENES == 1 && BOND_PORTS == 0 && defined(RUNS)
/* One scene that nothing moves: as far as nothing changes at once. */
static void steps(long n) {
    while (n > 0) {
        long part = n;
#ifdef PULLS
        const long at = sample % 30;
        if (at == 0) bond_input(scene, 0, 5.0);
        if (at == 25) bond_input(scene, 0, -5.0);
        part = (at < 25 ? 25 : 30) - at;
        if (part > n) part = n;
#endif
        if (bond_run(scene, (unsigned long)part)) {
            fprintf(stderr, "a step failed\n");
            exit(3);
        }
        sample += part, n -= part;
    }
}
#elif defined(BESIDE) && BOND_PORTS == 0 && !defined(PULLS)
/* Lanes that nothing moves: one group of them after the other. */
static void steps(long n) {
    int i;
    for (i = 0; i < ALL; ++i)
        if (bond_lanes_run(&scene[i], (unsigned long)n)) {
            fprintf(stderr, "a step failed\n");
            exit(3);
        }
    sample += n;
}
#else
static void steps(long n) {
    long k;
    int i;
    for (k = 0; k < n; ++k, ++sample) {
        for (i = 0; i < ALL; ++i) {
#ifdef PULLS
            if (sample % 30 == 0) bond_input(&scene[i], 0, 5.0);
            if (sample % 30 == 25) bond_input(&scene[i], 0, -5.0);
#endif
            if (COMMIT(&scene[i], moved)) {
                fprintf(stderr, "a step failed\n");
                exit(3);
            }
        }
    }
}
#endif
static int look(double *out) {
    bond_real probes[BOND_PROBES + 1];
    int i;
#ifdef BESIDE
    static bond_state first;
    bond_lanes_get(&scene[0], 0, &first);
    if (bond_probes(&first, probes)) exit(3);
#else
    if (bond_probes(&scene[0], probes)) exit(3);
#endif
    for (i = 0; i < BOND_PROBES && i < 16; ++i) out[i] = probes[i];
    return i;
}
#include "bench_main.h"
