#!/usr/bin/env python3
"""The loop of haptic.c from Python, by ctypes:

    bond build models/examples/open_port.bond --emit c -o wall.c
    cc -std=c99 -O2 -shared -fPIC wall.c -lm -o wall.so
    python3 models/embed/haptic.py wall.so wall.h
"""
import ctypes
import re
import sys


class Scene:
    """A compiled scene: the library, and the numbers that its header defines."""

    def __init__(self, library, header):
        self.lib = ctypes.CDLL(library if "/" in library else "./" + library)
        with open(header) as f:
            defines = re.findall(r"^#define BOND_(\w+) ([-+\d.e]+)", f.read(), re.M)
        self.define = {name: float(value) for name, value in defines}
        real, state = ctypes.c_double, ctypes.c_void_p
        for name, result in [("time", real), ("energy", real), ("ledger", real), ("commit", ctypes.c_int)]:
            getattr(self.lib, "bond_" + name).restype = result
        self.lib.bond_size.restype = ctypes.c_ulong
        self.state = ctypes.create_string_buffer(self.lib.bond_size())
        self.ports = int(self.define["PORTS"])
        self.numbers = lambda n: (real * max(int(n), 1))()
        self.lib.bond_init(self.state)

    def output(self):
        """What the scene holds at its open ports."""
        out = self.numbers(self.ports)
        self.lib.bond_output(self.state, out)
        return list(out)[: self.ports]

    def commit(self, moved):
        """Ends the interval: how far the outside moved at each port."""
        given = self.numbers(self.ports)
        given[: self.ports] = moved
        failed = self.lib.bond_commit(self.state, given)
        if failed:
            raise ArithmeticError(f"the interval at {self.time()} s failed: {failed}")

    def time(self):
        return self.lib.bond_time(self.state)

    def energy(self):
        return self.lib.bond_energy(self.state)

    def ledger(self, region, what):
        return self.lib.bond_ledger(self.state, region, int(self.define["LEDGER_" + what]))

    def save(self):
        saved = self.numbers(self.define["SAVED"])
        self.lib.bond_save(self.state, saved)
        return bytes(saved)

    def restore(self, saved):
        self.lib.bond_restore(self.state, saved)


def main():
    wall = Scene(sys.argv[1], sys.argv[2])
    m, push, drag, T = 0.5, 2.0, 4.0, wall.define["INTERVAL"]  # kg, N, N s/m, s
    x = v = given = 0.0
    for k in range(5000):
        force = wall.output()[0]
        a = (push - drag * v - force) / m
        moved = T * v + 0.5 * T * T * a
        v += T * a
        x += moved
        given += force * moved
        wall.commit([moved])
        if k == 2500:
            saved = wall.save()
    print(f"after {wall.time():.3f} s the handle is at {x:.6f} m and feels {force:.6f} N")
    print(
        f"the wall stores {wall.energy():.6g} J; it was given {given:.6g} J, "
        f"dissipated {wall.ledger(0, 'DISSIPATED'):.6g} J, its worst balance is {wall.ledger(0, 'WORST'):.1e}"
    )
    wall.restore(saved)
    print(f"put back, it is at {wall.time():.3f} s again")
    return 0 if abs(force - push) < 1e-3 else 1


if __name__ == "__main__":
    sys.exit(main())
