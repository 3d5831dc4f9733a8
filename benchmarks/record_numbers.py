"""Keep what benchmarks print as the numbers of the README: docs/numbers.json.

    python benchmarks/distances.py --n 320 | python benchmarks/record_numbers.py

Reads lines from the standard input and passes them on. A line that one of NUMBERS describes
replaces what docs/numbers.json has of it; all others stay. The README's table is made of the file
(`python benchmarks/record_numbers.py --table`), and a test fails where the two differ.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).parent.parent / "docs" / "numbers.json"
NUMBER = r"([\d.,]+)"


@dataclass(frozen=True)
class Number:
    """A row of the table: what it is of, which printed line it is taken from, and how it is put.

    Attributes:
        name: its key in the file.
        of: the words of the row.
        command: what prints it.
        pattern: of the line, with a group for each number.
        words: the value, with a place {0}, {1}, ... for each group.
    """

    name: str
    of: str
    command: str
    pattern: str
    words: str


FIT_BODIES = "benchmarks/fit_bodies.py --n 320 --only 'n: fit$'"
FIT = rf"fit +{NUMBER} +\d+ \| +{NUMBER} / +{NUMBER} deg.* flank {NUMBER} of"
TEACH = "benchmarks/teach.py table"
DETECTOR = (
    rf" \| 11000 \| mirror.* \| \d+ \| {NUMBER} \({NUMBER} to {NUMBER}\) {NUMBER} .*\| {NUMBER} \|"
)
DISTANCES = "benchmarks/distances.py --n 320"
BODY = rf"fitted body +K known +n +{NUMBER} .*\| +{NUMBER} / +{NUMBER} %"
NUMBERS = (
    Number(
        "trunk, own bodies",
        "fitted to keypoints and mask, K known: error of the trunk; flank right",
        FIT_BODIES,
        f"own: {FIT}",
        "{1} / {2} deg; {3} (n {0})",
    ),
    Number(
        "trunk, foreign bodies",
        "the same of bodies and keypoint places that are not ours",
        FIT_BODIES,
        f"foreign: {FIT}",
        "{1} / {2} deg; {3} (n {0})",
    ),
    Number(
        "distance, own bodies",
        "error of the distance, the length of the animal and K known",
        DISTANCES,
        f"own: {BODY}",
        "{1} / {2} % (n {0})",
    ),
    Number(
        "distance, foreign bodies",
        "the same of foreign bodies",
        DISTANCES,
        f"foreign: {BODY}",
        "{1} / {2} % (n {0})",
    ),
    Number(
        "distance, foreign bodies, learned",
        "the same after `calibrate` on 200 other animals of the dataset",
        f"{DISTANCES} --only learned",
        f"foreign, after learning: {BODY}",
        "{1} / {2} % (n {0})",
    ),
    Number(
        "distance, K unknown",
        "the same of our bodies, K unknown",
        DISTANCES,
        f"own: {BODY.replace('known', 'unknown')}",
        "{1} / {2} % (n {0})",
    ),
    Number(
        "detector, other bodies",
        "a detector taught on 11,000 drawn images, other bodies: error of the heading, flank right",
        TEACH,
        f"test-id{DETECTOR}",
        "{0} deg; {3} (n {4})",
    ),
    Number(
        "detector, other species",
        "the same of species that it never saw",
        TEACH,
        f"test-species{DETECTOR}",
        "{0} deg; {3} (n {4})",
    ),
)


def recorded(lines: Iterable[str], numbers: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    """The numbers of a file after some lines were printed.

    Args:
        lines: of a benchmark's output.
        numbers: name -> "value" and "command", as the file has them.

    """
    numbers = dict(numbers)
    for line in lines:
        for number in NUMBERS:
            match = re.match(number.pattern, line)
            if match is not None:
                value = number.words.format(*match.groups())
                numbers[number.name] = {"value": value, "command": number.command}
    return numbers


def table(numbers: dict[str, dict[str, str]]) -> str:
    """The README's table of the numbers that the file has."""
    rows = [
        f"| {number.of} | {numbers[number.name]['value']} | `{numbers[number.name]['command']}` |"
        for number in NUMBERS
        if number.name in numbers
    ]
    return "\n".join(
        ["| what | median / 95th percentile | measured by |", "| --- | --- | --- |", *rows, ""]
    )


def read_numbers() -> dict[str, dict[str, str]]:
    """What docs/numbers.json holds."""
    numbers: dict[str, dict[str, str]] = json.loads(FILE.read_text()) if FILE.exists() else {}
    return numbers


def main() -> None:
    """Record what comes in, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--table", action="store_true", help="print the table of the file")
    if parser.parse_args().table:
        print(table(read_numbers()), end="")
        return
    numbers = read_numbers()
    for line in sys.stdin:
        print(line, end="", flush=True)
        numbers = recorded([line], numbers)
    FILE.write_text(json.dumps(numbers, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
