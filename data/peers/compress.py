#!/usr/bin/env python3
"""Codes rows with codecs from outside, for `squall chart --peers`. [zfp], [sz3] in docs/references.md.

    compress.py list                what can be had here, as JSON on standard output
    compress.py code ID FOLDER      codes FOLDER/rows.f32 as FOLDER/task.json says

task.json: `shape` of a row (channels, z, y, x; x fastest), `rows`, `relative_l2` that each row may be off by, relative to
its own L2 norm, and `repeats` of the decoding that is timed. rows.f32: little-endian f32, row after row. Written are
back.f32, the rows as they decode, laid out alike, and coded.json: `bytes` of each row, everything counted that decoding it
needs but its shape, and `seconds` of processor time, one list a repeat with one figure a row.

Each row is coded by itself, as relighting reads single rows. What a codec takes is a bound of the pointwise error; the
largest is searched for whose row is off by `relative_l2` at most, which is what the product's own codecs are asked for.

Needs numpy, and zfpy or pysz: `pip install numpy zfpy pysz`. What is missing is left out and named.
"""

import json
import math
import os
import sys
import time

CLOCK = getattr(time, "thread_time", time.process_time)
# Steps of the search before a row is given up; the bounds of neighbouring rows are near each other, so three are usual.
TRIES = 80
# A bound is kept with its row where the stream does not hold it, and so is a length for each stream but a row's only one.
BOUND_BYTES = 8
LENGTH_BYTES = 4


class Zfp:
    """zfp with a fixed accuracy, without its header: the bound and the shape are what it would hold."""

    # zfp rounds its bound down to a power of two, and stays far below it.
    octaves = 1.0
    first = 4.0
    extra = BOUND_BYTES

    def __init__(self, numpy, zfpy):
        self.numpy, self.zfpy = numpy, zfpy

    def code(self, values, bound):
        return self.zfpy.compress_numpy(values, tolerance=bound, write_header=False)

    def decode(self, stream, bound, out):
        self.zfpy._decompress(stream, self.zfpy.type_float, out.shape, out=out, tolerance=bound)


class Sz3:
    """SZ3 with an absolute bound and its own choice of predictor (interpolation or Lorenzo)."""

    octaves = 0.125
    first = 0.5
    extra = 0

    def __init__(self, numpy, pysz):
        self.numpy, self.pysz = numpy, pysz

    def code(self, values, bound):
        config = self.pysz.szConfig()
        config.errorBoundMode = self.pysz.szErrorBoundMode.ABS
        config.absErrorBound = bound
        config.cmprAlgo = self.pysz.szAlgorithm.INTERP_LORENZO
        # The stream is a view of a buffer as large as its bound.
        return self.pysz.sz.compress(values, config)[0].copy()

    def decode(self, stream, bound, out):
        out[...] = self.pysz.sz.decompress(stream, self.numpy.float32, out.shape)[0]


def peers():
    """What is here as {id: (name, codec, whole)}, and words on what is not. `whole` rows are coded in four dimensions."""
    found, absent = {}, []
    try:
        import numpy
    except Exception as error:
        return found, ["zfp and SZ3: " + str(error)]
    try:
        import zfpy

        name = "zfp " + getattr(zfpy, "__version__", "of unknown version")
        found["zfp-4d"] = (name + ", 4-D", Zfp(numpy, zfpy), True)
        found["zfp-3d"] = (name + ", each channel 3-D", Zfp(numpy, zfpy), False)
    # A module built for another numpy fails in other ways than by being absent.
    except Exception as error:
        absent.append("zfp: " + str(error))
    try:
        import pysz

        try:
            from importlib.metadata import version

            name = "SZ3 (pysz " + version("pysz") + ")"
        except Exception:
            name = "SZ3 (pysz of unknown version)"
        # Channel by channel, each with tables of its own, it takes 2 to 16 % more bytes and a third more time on the sample
        # storm, and several times both on a few hundred cells.
        found["sz3-4d"] = (name + ", 4-D", Sz3(numpy, pysz), True)
    except Exception as error:
        absent.append("SZ3: " + str(error))
    return found, absent


def parts(values, whole):
    """A row as what is coded at once: all of it, or channel by channel."""
    return [values] if whole else list(values)


class Row:
    """A row coded with one bound."""

    def __init__(self, codec, values, whole, exponent):
        self.bound = 2.0**exponent
        self.streams = [codec.code(part, self.bound) for part in parts(values, whole)]
        lengths = LENGTH_BYTES * (len(self.streams) - 1)
        self.bytes = sum(len(stream) for stream in self.streams) + lengths + codec.extra

    def decode(self, codec, whole, out):
        for stream, part in zip(self.streams, parts(out, whole)):
            codec.decode(stream, self.bound, part)


def searched(numpy, codec, whole, values, asked, out, offset):
    """The row with the largest bound that keeps `asked`, and that bound over asked × rms in octaves: where to begin next."""
    norm = float(numpy.linalg.norm(values.astype(numpy.float64)))
    if norm == 0.0:
        return Row(codec, values, whole, -126.0), offset
    unit = math.log2(asked * norm / math.sqrt(values.size))
    step = codec.octaves
    at = math.floor((unit + offset) / step)
    fits, fails, kept = None, None, None
    for _ in range(TRIES):
        row = Row(codec, values, whole, at * step)
        row.decode(codec, whole, out)
        error = float(numpy.linalg.norm(out.astype(numpy.float64) - values)) / norm
        # Errors grow about as bounds do.
        ahead = math.floor(math.log2(asked / error) / step) if error > 0.0 else 4
        if error <= asked:
            fits, kept = at, row
            at += max(ahead, 1)
            at = at if fails is None else min(at, fails - 1)
        else:
            fails = at
            at += min(ahead, -1)
            at = at if fits is None else max(at, fits + 1)
        if fits is not None and fails is not None and fails - fits <= 1:
            break
    if kept is not None:
        return kept, fits * step - unit
    raise SystemExit("no bound brings a row to a relative L2 error of %g" % asked)


def code(peer, folder):
    import numpy

    name, codec, whole = peer
    with open(os.path.join(folder, "task.json"), encoding="utf-8") as file:
        task = json.load(file)
    shape, asked = tuple(task["shape"]), float(task["relative_l2"])
    length, out = math.prod(shape), numpy.zeros(shape, numpy.float32)
    rows, offset = [], math.log2(codec.first)
    with open(os.path.join(folder, "rows.f32"), "rb") as file, open(os.path.join(folder, "back.f32"), "wb") as back:
        for _ in range(task["rows"]):
            values = numpy.fromfile(file, "<f4", length).astype(numpy.float32).reshape(shape)
            row, offset = searched(numpy, codec, whole, values, asked, out, offset)
            row.decode(codec, whole, out)
            out.astype("<f4").tofile(back)
            rows.append(row)
    seconds = []
    for _ in range(task["repeats"]):
        times = []
        for row in rows:
            start = CLOCK()
            row.decode(codec, whole, out)
            times.append(CLOCK() - start)
        seconds.append(times)
    with open(os.path.join(folder, "coded.json"), "w", encoding="utf-8") as file:
        json.dump({"bytes": [row.bytes for row in rows], "seconds": seconds}, file)


def main(arguments):
    found, absent = peers()
    if arguments == ["list"]:
        listed = [{"id": id, "name": peer[0]} for id, peer in found.items()]
        print(json.dumps({"peers": listed, "absent": absent}))
    elif len(arguments) == 3 and arguments[0] == "code" and arguments[1] in found:
        code(found[arguments[1]], arguments[2])
    else:
        raise SystemExit("wanted: list, or code ID FOLDER with ID one of " + (", ".join(found) or "none"))


if __name__ == "__main__":
    main(sys.argv[1:])
