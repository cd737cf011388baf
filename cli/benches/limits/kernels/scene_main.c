/* Times a scene that `bond build` emitted, SCENES of it in turn; with PULLS its first input pulls for 5 samples of every 30. */
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
static int look(double *out) {
    bond_real probes[BOND_PROBES + 1];
    int i;
    if (bond_probes(&scene[0], probes)) exit(3);
    for (i = 0; i < BOND_PROBES && i < 16; ++i) out[i] = probes[i];
    return i;
}
#include "bench_main.h"
