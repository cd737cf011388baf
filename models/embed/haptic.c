/* A haptic loop around a compiled scene: the wall of models/examples/open_port.bond, felt by a handle that a hand pushes.

       bond build models/examples/open_port.bond --emit c -o wall.c
       cc -std=c99 -O2 -I. wall.c models/embed/haptic.c -lm -o haptic
       ./haptic

   (or --emit object -o wall.o, and wall.o in the place of wall.c). In a device the handle below is the real one: read its encoder,
   take the difference to the last reading for `moved`, and give `force` to the motor. */
#include "wall.h"
#include <math.h>
#include <stdio.h>

int main(void) {
    static bond_state wall; /* plain data: no allocation anywhere */
    static bond_real saved[BOND_SAVED];
    bond_real force[BOND_PORTS], moved[BOND_PORTS];
    const double m = 0.5, push = 2.0, drag = 4.0, T = BOND_INTERVAL; /* kg, N, N s/m, s */
    double x = 0, v = 0, given = 0;
    int k, failed;

    bond_init(&wall);
    for (k = 0; k < 5000; ++k) {
        /* The force that the wall holds over this interval; on the handle it acts the other way. */
        bond_output(&wall, force);
        {
            const double a = (push - drag * v - force[0]) / m;
            moved[0] = (bond_real)(T * v + 0.5 * T * T * a);
            v += T * a;
        }
        x += moved[0];
        given += force[0] * moved[0];
        failed = bond_commit(&wall, moved);
        if (failed) {
            fprintf(stderr, "the interval at %g s failed: %d\n", (double)bond_time(&wall), failed);
            return 1;
        }
        if (k == 2500) bond_save(&wall, saved);
    }
    printf("after %.3f s the handle is at %.6f m and feels %.6f N\n", (double)bond_time(&wall), x, (double)force[0]);
    printf("the wall stores %.6g J; it was given %.6g J, dissipated %.6g J, its worst balance is %.1e\n",
           (double)bond_energy(&wall), given, (double)bond_ledger(&wall, 0, BOND_LEDGER_DISSIPATED),
           (double)bond_ledger(&wall, 0, BOND_LEDGER_WORST));
    bond_restore(&wall, saved);
    printf("put back, it is at %.3f s again\n", (double)bond_time(&wall));
    return fabs(force[0] - push) < 1e-3 ? 0 : 1;
}
