/* Many scenes side by side: 128 walls of models/examples/open_port.bond, each felt by a handle of its own mass.

       bond build models/examples/open_port.bond --emit c -o wall.c
       cc -std=c99 -O3 -march=native -ffp-contract=off -DBOND_LANES=64 -I. wall.c models/embed/many.c -lm -o many
       ./many

   Each lane has the numbers that its wall has alone, to the last bit; the first one is gone through alone besides. */
#include "wall.h"
#include <stdio.h>
#include <string.h>

enum { GROUPS = 2 };

int main(void) {
    static bond_lanes walls[GROUPS];
    static bond_state alone, seen;
    static bond_real force[BOND_PORTS * BOND_LANES], moved[BOND_PORTS * BOND_LANES];
    static bond_real saved[BOND_SAVED], wanted[BOND_SAVED];
    static double x[GROUPS][BOND_LANES], v[GROUPS][BOND_LANES];
    const double push = 2.0, drag = 4.0, T = BOND_INTERVAL; /* N, N s/m, s */
    double least = 1, most = 0;
    int g, k, l;

    for (g = 0; g < GROUPS; ++g) bond_lanes_init(&walls[g]);
    bond_init(&alone);
    for (k = 0; k < 5000; ++k) {
        for (g = 0; g < GROUPS; ++g) {
            bond_lanes_output(&walls[g], force);
            for (l = 0; l < BOND_LANES; ++l) {
                const double m = 0.2 + 0.01 * (g * BOND_LANES + l); /* kg */
                const double a = (push - drag * v[g][l] - force[l]) / m;
                moved[l] = (bond_real)(T * v[g][l] + 0.5 * T * T * a);
                v[g][l] += T * a;
                x[g][l] += moved[l];
            }
            if (g == 0 && bond_commit(&alone, moved)) return 1;
            if (bond_lanes_commit(&walls[g], moved) > 0) {
                for (l = 0; l < BOND_LANES; ++l)
                    if (walls[g].failed[l]) fprintf(stderr, "wall %d failed: %d\n", g * BOND_LANES + l, walls[g].failed[l]);
                return 1;
            }
        }
    }
    for (g = 0; g < GROUPS; ++g) {
        for (l = 0; l < BOND_LANES; ++l) {
            least = x[g][l] < least ? x[g][l] : least;
            most = x[g][l] > most ? x[g][l] : most;
        }
    }
    bond_lanes_get(&walls[0], 0, &seen);
    bond_save(&seen, saved);
    bond_save(&alone, wanted);
    printf("%d handles are between %.4f and %.4f m at %.3f s\n", GROUPS * BOND_LANES, least, most, (double)bond_time(&seen));
    printf("the first one has %s bits as alone\n", memcmp(saved, wanted, sizeof saved) ? "other" : "the same");
    return memcmp(saved, wanted, sizeof saved) != 0;
}
