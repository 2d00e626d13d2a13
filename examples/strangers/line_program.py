"""A program that answers an audit in bytes: the exact posterior of the line that sbi_npe.py tells of.

Needs the standard library only, and shows all there is to the protocol: a length, a JSON header of that
length, and for each array in it a length and a .npy file.
"""

import ast
import json
import math
import random
import struct
import sys
from array import array

TIMES = [-1.0 + 2.0 * k / 7.0 for k in range(8)]
NOISE = 0.5
# The columns 1 and t are orthogonal, so that the two parameters have posteriors of their own.
PRECISION = [1.0 + 8.0 / NOISE**2, 1.0 + sum(t * t for t in TIMES) / NOISE**2]


def read(size):
    """So many bytes; the end of the audit is the end of the program."""
    content = sys.stdin.buffer.read(size)
    if len(content) < size:
        sys.exit(0)
    return content


def receive():
    """A request: its header, and its arrays as (shape, flat numbers)."""
    header = json.loads(read(struct.unpack(">I", read(4))[0]))
    arrays = {}
    for name in header.get("arrays", []):
        content = read(struct.unpack(">Q", read(8))[0])
        length = struct.unpack("<H", content[8:10])[0]
        entry = ast.literal_eval(content[10 : 10 + length].decode("latin1"))
        values = array("d" if entry["descr"] == "<f8" else "q")
        values.frombytes(content[10 + length :])
        arrays[name] = entry["shape"], values
    return header, arrays


def answer(header, shape=None, values=None):
    """Write a header and, if there is one, the array that it names."""
    text = json.dumps(header).encode()
    out = [struct.pack(">I", len(text)), text]
    if values is not None:
        entry = repr({"descr": "<f8", "fortran_order": False, "shape": shape}).encode()
        entry += b" " * (-(len(entry) + 11) % 64) + b"\n"
        npy = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(entry)) + entry + values.tobytes()
        out += [struct.pack(">Q", len(npy)), npy]
    sys.stdout.buffer.write(b"".join(out))
    sys.stdout.buffer.flush()


def sample(shape, x, n, seed):
    """Draws, (batch, n, 2)."""
    generator = random.Random(seed)
    draws = array("d")
    for row in range(shape[0]):
        data = x[8 * row : 8 * row + 8]
        sums = [sum(data), sum(t * value for t, value in zip(TIMES, data, strict=True))]
        means = [s / NOISE**2 / p for s, p in zip(sums, PRECISION, strict=True)]
        spreads = [1.0 / math.sqrt(p) for p in PRECISION]
        for _ in range(n):
            draws.append(generator.gauss(means[0], spreads[0]))
            draws.append(generator.gauss(means[1], spreads[1]))
    return (shape[0], n, 2), draws


while True:
    request, given = receive()
    kind = request["request"]
    if kind == "describe":
        names = ["theta_1", "theta_2"]
        answer({"answer": kind, "parameters": names, "can": ["sample"], "versions": {}, "library": "none"})
    elif kind == "sample":
        answer({"answer": kind, "arrays": ["draws"]}, *sample(*given["x"], request["n"], request["seed"]))
    elif kind == "stop":
        break
    else:
        answer({"error": "this program only samples"})
