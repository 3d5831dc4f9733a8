"""Byte-mutants of honest SMAL pickles: each must be read or refused with ModelFileError, soon.

And the times of honest loads.

Run: OMP_NUM_THREADS=1 PYTHONPATH=tests/support python benchmarks/pickle_mutants.py [--mutants
20000] [--seed 0]
"""

import argparse
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from smal_pickles import python3_pickle, random_content, written

from animal3dbox.errors import ModelFileError
from animal3dbox.smal.files.model_files import load_smal
from animal3dbox.smal.files.safetensors_file import load_safetensors, save_safetensors
from animal3dbox.smal.model import SmalModel

TOKENS = (
    b"\n",
    b"\r\n",
    b".",
    b"(",
    b"t",
    b"R",
    b"b",
    b"c",
    b"\x80",
    b"\x93",
    b"\x95",
    b"\xff\xff\xff\x7f",
    b"0",
    b"2",
    b"e",
    b"u",
    b"-1",
    b"\\x",
)


def mutant(data: bytes, rng: np.random.Generator) -> bytes:
    """The data with 1 to 4 changes: a byte, a bit, a token, a cut, a doubled or a swapped piece."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at, end = sorted(int(i) for i in rng.integers(0, len(out) + 1, 2))
        end = min(end, at + int(rng.integers(1, 64)))
        kind = rng.integers(0, 7)
        if kind == 0:
            out[at : at + 1] = rng.bytes(1)
        elif kind == 1 and at < len(out):
            out[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 2:
            token = TOKENS[rng.integers(0, len(TOKENS))]
            out[at : at + len(token)] = token
        elif kind == 3:
            out[at:at] = TOKENS[rng.integers(0, len(TOKENS))]
        elif kind == 4:
            del out[at:end]
        elif kind == 5:
            out[at:at] = out[at:end]
        else:
            other = int(rng.integers(0, len(out) + 1))
            out[at:end] = out[other : other + end - at]
        out = out or bytearray(b".")
    return bytes(out)


def seeds() -> list[bytes]:
    """Small honest files: their opcodes, not their numbers, are most of their bytes."""
    tiny = random_content(vertices=2, faces=1, joints=2, betas=1)
    plain = random_content(vertices=3, faces=2, joints=3, betas=2, chumpy=False)
    old = [written(content, protocol) for content in (tiny, plain) for protocol in range(6)]
    return old + [
        python3_pickle(content, protocol) for content in (tiny, plain) for protocol in range(3)
    ]


def run_mutants(count: int, seed: int, folder: Path) -> None:
    """Print how many were read and refused, every crash, and the slowest."""
    rng, files, path = np.random.default_rng(seed), seeds(), folder / "mutant.pkl"
    ended: Counter[str] = Counter()
    worst = (0.0, 0)
    for k in range(count):
        path.write_bytes(mutant(files[k % len(files)], rng))
        begin = time.perf_counter()
        try:
            load_smal(path)
            ended["read"] += 1
        except ModelFileError:
            ended["refused"] += 1
        except Exception as error:  # noqa: BLE001
            ended["CRASHED"] += 1
            print(f"mutant {k}: {type(error).__name__}: {error}")
        worst = max(worst, (time.perf_counter() - begin, k))
    print(
        f"{count} mutants of {len(files)} files: {dict(ended)}, crashes {ended['CRASHED']}, worst"
        f" {1e3 * worst[0]:.1f} ms (mutant {worst[1]})"
    )


def best_of_three(load: Callable[[Path], SmalModel], path: Path) -> float:
    """Seconds."""
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        load(path)
        times.append(time.perf_counter() - begin)
    return min(times)


def run_honest(folder: Path) -> None:
    """Print the times of a model in SMAL's exact shapes, best of three."""
    content, path, converted = (
        random_content(vertices=3889, faces=7774),
        folder / "smal.pkl",
        folder / "smal.safetensors",
    )
    for protocol in range(6):
        path.write_bytes(written(content, protocol))
        print(
            f"protocol {protocol}: {path.stat().st_size / 1e6:6.1f} MB,"
            f" {best_of_three(load_smal, path):.3f} s"
        )
    save_safetensors(load_smal(path), converted)
    print(f"safetensors: {best_of_three(load_safetensors, converted):.3f} s")


def main() -> None:
    """Both, with warnings as errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutants", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as folder:
        run_honest(Path(folder))
        run_mutants(options.mutants, options.seed, Path(folder))


if __name__ == "__main__":
    main()
