#!/usr/bin/env python3
"""A device for `serve --udp`: a mass that a random force pushes about, and that feels what the environment holds.

    ./wall serve --udp 127.0.0.1:7000 --duration 10s
    python3 device.py 127.0.0.1:7000 --drop 0.05 --delay 0.05

It ends when the environment does, and prints one line of JSON: what it counted by itself. Only the standard library is
needed; for --key-file also `pip install blake3`.
A device keeps three rules (docs/reference/serve.md): take only efforts with a higher number, hold each for no longer than it lasts, and
never let the energy of a group of ports fall below its limit. Then nothing that the line does can make it draw energy that
is not there.
"""

import argparse
import hmac
import json
import math
import random
import socket
import struct
import time
import zlib

END = 8


def pack_measurement(session, sequence, echo, wait, q, w):
    body = struct.pack(f"<4sIQQQd{2 * len(q)}dI", b"BNDM", len(q), session, sequence, echo, wait, *q, *w, 0)
    return body + struct.pack("<I", zlib.crc32(body))


def unpack_effort(data):
    """The effort in a packet, or None where it is none."""
    if len(data) < 56 or data[:4] != b"BNDE" or zlib.crc32(data[:-4]) != struct.unpack("<I", data[-4:])[0]:
        return None
    n = struct.unpack_from("<I", data, 4)[0]
    if len(data) != 56 + 24 * n:
        return None
    session, sequence, _time, lasts, _stored = struct.unpack_from("<QQddd", data, 8)
    v = struct.unpack_from(f"<{n}d", data, 48)
    limit = struct.unpack_from(f"<{n}d", data, 48 + 8 * n)
    group = struct.unpack_from(f"<{n}Q", data, 48 + 16 * n)
    status = struct.unpack_from("<I", data, 48 + 24 * n)[0]
    if not all(math.isfinite(x) for x in (lasts, *v)) or any(math.isnan(x) for x in limit):
        return None
    return {"session": session, "sequence": sequence, "lasts": lasts, "v": v, "limit": limit, "group": group, "status": status}


def read_key(path):
    """A key: 32 bytes, or 64 hexadecimal digits."""
    with open(path, "rb") as file:
        data = file.read()
    key = data if len(data) == 32 else bytes.fromhex(data.decode("ascii"))
    if len(key) != 32:
        raise ValueError(f"{path}: a key is 32 bytes or 64 hexadecimal digits")
    return key


class Seal:
    """Seals measurements and opens efforts with a key; without one it leaves them as they are."""

    def __init__(self, key):
        # Higher than all numbers of earlier lives, so that what was recorded then answers none of this one.
        self.key, self.before, self.heard = key, time.time_ns(), 0
        self.sent = self.before

    def tag(self, body):
        from blake3 import blake3

        return blake3(body, key=self.key).digest()

    def seal(self, packet):
        if self.key is None:
            return packet
        self.sent += 1
        body = struct.pack("<4sIQQ", b"BNDS", 1, self.sent, self.heard) + packet
        return body + self.tag(body)

    def open(self, data):
        """The packet, or None where it is a stranger's, was heard before, or answers nothing that was sent."""
        if self.key is None:
            return data
        if len(data) < 56 or data[:8] != struct.pack("<4sI", b"BNDS", 1):
            return None
        number, answered = struct.unpack_from("<QQ", data, 8)
        if number <= self.heard or not self.before < answered <= self.sent:
            return None
        if not hmac.compare_digest(self.tag(data[:-32]), data[-32:]):
            return None
        self.heard = number
        return data[24:-32]


class Device:
    """Keeps the three rules and the counts."""

    def __init__(self, ports):
        self.ports, self.session, self.held, self.came = ports, 0, None, 0.0
        self.clear()

    def clear(self):
        self.sequence, self.q, self.w = 0, [0.0] * self.ports, [0.0] * self.ports

    def receive(self, effort, now):
        if len(effort["v"]) != self.ports:
            return
        if effort["session"] > self.session:
            self.session = effort["session"]
            self.clear()
        elif effort["session"] < self.session or effort["sequence"] <= self.held["sequence"]:
            return  # rule 1
        self.held, self.came = effort, now

    def efforts(self, dq, now):
        """What may be held over a movement dq: rule 2, and rule 3 for each group."""
        e = self.held
        if e is None or now - self.came > e["lasts"] or e["status"] & END:
            return [0.0] * self.ports
        held = list(e["v"])
        for g in set(e["group"]):
            own = [i for i in range(self.ports) if e["group"][i] == g]
            given = sum(e["v"][i] * dq[i] for i in own)
            left = sum(self.w[i] for i in own) - e["limit"][own[0]]
            if given < 0.0 and left + given < 0.0:
                part = min(max(left / -given, 0.0), 1.0)
                for i in own:
                    held[i] *= part
        return held

    def moved(self, dq, held):
        for i in range(self.ports):
            self.q[i] += dq[i]
            self.w[i] += held[i] * dq[i]

    def measurement(self, now):
        self.sequence += self.session != 0
        echo = self.held["sequence"] if self.held else 0
        return pack_measurement(self.session, self.sequence, echo, now - self.came if self.held else 0.0, self.q, self.w)


class Line:
    """Loses, delays and doubles packets at random."""

    def __init__(self, drop, delay, dice):
        self.drop, self.delay, self.dice, self.queue = drop, delay, dice, []

    def put(self, now, packet):
        if self.dice.random() < self.drop:
            return
        for _ in range(2 if self.dice.random() < self.drop else 1):
            late = self.dice.uniform(0.0, 0.01) if self.dice.random() < self.delay else 0.0
            self.queue.append((now + late, packet))

    def take(self, now):
        ready = [p for at, p in self.queue if at <= now]
        self.queue = [x for x in self.queue if x[0] > now]
        return ready


def main():
    parser = argparse.ArgumentParser(description="A pushed mass for `serve --udp`.")
    parser.add_argument("address", help="where the environment listens, such as 127.0.0.1:7000")
    parser.add_argument("--ports", type=int, default=1, help="open ports of the scene")
    parser.add_argument("--mass", type=float, default=0.5, help="kg")
    parser.add_argument("--push", type=float, default=10.0, help="largest random force, N")
    parser.add_argument("--lean", type=float, default=4.0, help="constant force towards the environment, N")
    parser.add_argument("--tick", type=float, default=2.5e-4, help="the device's own step, s")
    parser.add_argument("--drop", type=float, default=0.0, help="part of the packets that is lost, in each direction")
    parser.add_argument("--delay", type=float, default=0.0, help="part of the packets that is up to 10 ms late")
    parser.add_argument("--thief", action="store_true", help="move so as to draw energy wherever the rules let it")
    parser.add_argument("--reply", action="store_true", help="measure half an interval after each effort, not at each step")
    parser.add_argument("--key-file", help="the key that the environment has too: 32 bytes, or 64 hexadecimal digits")
    parser.add_argument("--give-up", type=float, default=5.0, help="end after so long without a word, s")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()

    host, port = args.address.rsplit(":", 1)
    peer = (host.strip("[]"), int(port))
    line = socket.socket(socket.AF_INET6 if ":" in peer[0] else socket.AF_INET, socket.SOCK_DGRAM)
    line.setblocking(False)
    dice = random.Random(args.seed)
    out, back = Line(args.drop, args.delay, dice), Line(args.drop, args.delay, dice)
    device = Device(args.ports)
    seal = Seal(read_key(args.key_file) if args.key_file else None)
    n = args.ports
    speed, push = [0.0] * n, [0.0] * n
    put_in = given_out = lowest = 0.0
    start = heard = last = time.monotonic()
    told = renewed = 0.0
    replied = None
    over = False
    while not over and time.monotonic() - heard < args.give_up:
        now = time.monotonic()
        while True:
            try:
                back.put(now, line.recv(4096))
            except (BlockingIOError, ConnectionRefusedError):
                break
        for packet in back.take(now):
            packet = seal.open(packet)
            effort = unpack_effort(packet) if packet else None
            if effort:
                heard = now
                device.receive(effort, now)
                over = over or (effort["session"] == device.session and effort["status"] & END != 0)
        dt, last = now - last, now
        if now - renewed > 0.05:
            renewed, push = now, [args.lean + args.push * dice.uniform(-1.0, 1.0) for _ in range(n)]
        dq = [s * dt for s in speed]
        if args.thief and device.held:
            # Mostly along the effort, which draws; now and then against it.
            dq = [1e-3 * dice.random() * (1 if v <= 0 or dice.random() < 0.3 else -1) for v in device.held["v"]]
        held = device.efforts(dq, now)
        energy = sum(f * d for f, d in zip(held, dq))
        device.moved(dq, held)
        put_in, given_out = put_in + max(energy, 0.0), given_out + max(-energy, 0.0)
        lowest = min(lowest, sum(device.w))
        # A held effort pushes back; a little drag keeps the mass in the room.
        speed = [s + (p - f - 2.0 * s) * dt / args.mass for s, p, f in zip(speed, push, held)]
        # Where nothing new comes it says so again now and then: the last one may have been lost.
        due = now - told > 0.05
        if device.session != 0 and not args.reply:
            due = True
        elif device.session != 0 and device.held["sequence"] != replied:
            due = due or now - device.came >= 0.5 * device.held["lasts"] / 3.0
        if due:
            told, replied = now, device.held and device.held["sequence"]
            out.put(now, seal.seal(device.measurement(now)))
        for packet in out.take(now):
            try:
                line.sendto(packet, peer)
            except ConnectionRefusedError:
                pass
        time.sleep(max(0.0, args.tick - (time.monotonic() - now)))
    print(json.dumps({
        "seconds": time.monotonic() - start, "session": device.session, "measurements": device.sequence,
        "put_in": put_in, "given_out": given_out, "lowest": lowest, "moved": device.q,
    }))


if __name__ == "__main__":
    main()
