"""Reads files in a process of its own and tells what happened.

Imports, files opened, programs started, functions called, memory.

Run: python pickle_watch.py FOLDER HONEST [unpickle]; prints JSON. With `unpickle`, Python's own
pickle reads the files, which shows that the watch sees what it should.
"""

import json
import pickle
import re
import resource
import sys
import types
from collections import Counter
from pathlib import Path

from animal3dbox.errors import ModelFileError
from animal3dbox.smal.files.model_files import load_smal, load_symmetry

calls: list[str] = []
events: Counter[str] = Counter()
own_file = ""


def hook(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open":
        if str(arguments[0]) != own_file or arguments[1] not in ("r", "rb"):
            events[f"open {arguments[0]}"] += 1
    elif event.split(".")[0] in (
        "import",
        "exec",
        "compile",
        "os",
        "subprocess",
        "socket",
        "ctypes",
        "pickle",
        "marshal",
        "mmap",
        "shutil",
        "pty",
    ):
        events[f"{event} {arguments[:1]}"] += 1


class Setter:
    def __setstate__(self, state: object) -> None:
        calls.append("Setter")


def fire(*arguments: object) -> None:
    calls.append("fire")


def read(path: Path, unpickle: bool) -> list[str]:
    """What each reader said of a file."""
    global own_file
    own_file = str(path)
    if unpickle:
        try:
            with path.open("rb") as file:
                pickle.load(file, encoding="latin1")
        except Exception as error:  # noqa: BLE001
            return [type(error).__name__]
        return ["read"]
    said = []
    for reader in (load_smal, load_symmetry):
        try:
            reader(path)
            said.append("read")
        except ModelFileError:
            said.append("refused")
    return said


def memory_kib(field: str) -> int:
    """Memory in use now (VmRSS) or at most so far (VmHWM).

    Where the system does not tell, the peak that getrusage gives.

    The peak of getrusage would do for neither: after a fork it starts at the parent's.
    """
    status = Path("/proc/self/status")
    found = re.search(rf"{field}:\s*(\d+) kB", status.read_text()) if status.exists() else None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if found is None else int(found[1])


def main() -> None:
    folder, honest, unpickle = Path(sys.argv[1]), Path(sys.argv[2]), len(sys.argv) > 3
    target = types.ModuleType("hostile_target")
    vars(target).update(fire=fire, Setter=Setter)
    sys.modules["hostile_target"] = target
    files = sorted(folder.iterdir())
    load_smal(honest)
    modules, memory = set(sys.modules), memory_kib("VmRSS")
    sys.addaudithook(hook)
    said = {path.name: read(path, unpickle) for path in files}
    seen = dict(events)  # before the watch itself opens a file
    grown = (memory_kib("VmHWM") - memory) / 1024
    new = sorted(set(sys.modules) - modules)
    sys.stdout.write(
        json.dumps(
            {"said": said, "calls": calls, "events": seen, "modules": new, "grown_mb": grown}
        )
    )


if __name__ == "__main__":
    main()
