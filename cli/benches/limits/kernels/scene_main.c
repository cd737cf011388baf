/* Times a scene that `bond build` emitted, SCENES of it in turn; with PULLS its first input pulls for 5 samples of every 30,
   with RUNS it has a `bond_run`. */
#include "bench.h"
#include "scene.h"

static bond_state scene[SCENES];
static bond_real moved[BOND_PORTS + 1];
static long sample;

static void begin(int size) {
    int i;
    (void)size;
    for (i = 0; i < SCENES; ++i) bond_init(&scene[i]);
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
#else
static void steps(long n) {
    long k;
    int i;
    for (k = 0; k < n; ++k, ++sample) {
        for (i = 0; i < SCENES; ++i) {
#ifdef PULLS
            if (sample % 30 == 0) bond_input(&scene[i], 0, 5.0);
            if (sample % 30 == 25) bond_input(&scene[i], 0, -5.0);
#endif
            if (bond_commit(&scene[i], moved)) {
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
    if (bond_probes(&scene[0], probes)) exit(3);
    for (i = 0; i < BOND_PROBES && i < 16; ++i) out[i] = probes[i];
    return i;
}
#include "bench_main.h"
