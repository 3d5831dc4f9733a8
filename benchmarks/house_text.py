"""What can be counted of a checkout by reading its text and its syntax trees.

"The package" is animal3dbox/ with datasets/ and transforms/; links in the tree are not followed.
A function is every `def`, of a class or in another function too, but no lambda.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from house_imports import package_files

Function = ast.FunctionDef | ast.AsyncFunctionDef
Counts = dict[str, float]
HOUSE_PARTICIPLES = frozenset(("found", "seen", "kept", "told", "said", "asked", "made", "left"))
"""The names of what happened to a thing that house.md lists."""
FURTHER_PARTICIPLES = frozenset(
    ("given", "sent", "received", "opened", "read", "drawn", "posed", "known", "shown")
)
"""More of them, counted apart."""
FILE_LIMITS = (300, 400)
FUNCTION_LIMIT = 40
POSITIONAL_LIMIT = 4
WORDS_OF_A_RIDDLE = 3


def text_counts(root: Path) -> Counts:
    """Everything that is counted of a checkout's text."""
    files = list(package_files(root).values())
    trees = [ast.parse(path.read_text()) for path in files]
    tests, *scripts = (
        sorted((root / n).rglob("*.py")) for n in ("tests", "benchmarks", "examples")
    )
    pages = sorted([*root.glob("*.md"), *(root / "docs").rglob("*.md")])
    return {
        **folder_counts(root, files),
        **long_lines("package", files),
        **long_lines("tests", tests),
        **long_lines("benchmarks and examples", [path for folder in scripts for path in folder]),
        **long_lines("pages (.md)", pages),
        **conversions(root, files),
        **docstring_counts(trees),
        **participles("package", trees),
        **participles("tests", [ast.parse(path.read_text()) for path in tests]),
        **function_counts(trees),
    }


def folder_counts(root: Path, files: Sequence[Path]) -> Counts:
    """Files and lines that lie directly in each folder, rooms apart from the folder they are in.

    Blank lines are lines. Files over a limit have more lines than that.
    """
    lengths = {path: len(path.read_text().splitlines()) for path in files}
    folders = sorted({path.parent for path in files})
    counts: Counts = {"files: package": len(files)}
    for folder in folders:
        inside = [length for path, length in lengths.items() if path.parent == folder]
        counts[f"files: {folder.relative_to(root)}"] = len(inside)
    counts["lines: package"] = sum(lengths.values())
    for folder in folders:
        inside = [length for path, length in lengths.items() if path.parent == folder]
        counts[f"lines: {folder.relative_to(root)}"] = sum(inside)
    for limit in FILE_LIMITS:
        counts[f"files over {limit} lines"] = sum(n > limit for n in lengths.values())
    return counts


def long_lines(name: str, files: Iterable[Path]) -> Counts:
    """Lines of more than 100 and 120 characters: how many, and their percentage of all lines.

    Blank lines do not count: house.md's 13 % and 6 % are shares of lines that hold something.
    """
    lines = [line for path in files for line in path.read_text().splitlines() if line.strip()]
    counts: Counts = {}
    for limit in (100, 120):
        longer = sum(len(line) > limit for line in lines)
        counts[f"{name}: lines over {limit} columns"] = longer
        counts[f"{name}: % of lines over {limit} columns"] = _percent(longer, len(lines))
    return counts


def conversions(root: Path, files: Sequence[Path]) -> Counts:
    """Conversions between torch and NumPy in labels/ and datasets/, by their names in the text.

    `.numpy()` and `from_numpy` are what house.md counts; `as_tensor` and `torch.tensor(` stand
    apart, for they also make tensors of numbers. Rooms within the two folders count with them.
    """
    patterns = {
        ".numpy() and from_numpy": r"\.numpy\(\)|from_numpy",
        "as_tensor": r"\bas_tensor\b",
        "torch.tensor(": r"\btorch\.tensor\(",
    }
    counts: Counts = {}
    for folder in ("animal3dbox/labels", "datasets"):
        inside = [path for path in files if (root / folder) in path.parents]
        text = "\n".join(path.read_text() for path in inside)
        for name, pattern in patterns.items():
            counts[f"{folder}: {name}"] = len(re.findall(pattern, text))
    return counts


def docstring_counts(trees: Sequence[ast.Module]) -> Counts:
    """Docstrings of modules, classes and functions of the package.

    The first line is the first that is not blank; words are what blanks separate. A docstring
    has an example if one of its lines is "Example:" or "Examples:", and a runnable one if it
    has a `>>>` too.
    """
    texts = [
        text
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | Function)
        and (text := ast.get_docstring(node))
    ]
    first_lines = [text.strip().splitlines()[0] for text in texts]
    examples = [text for text in texts if re.search(r"^\s*Examples?:\s*$", text, re.MULTILINE)]
    return {
        "docstrings": len(texts),
        "docstrings: first line of three words or fewer": sum(
            len(line.split()) <= WORDS_OF_A_RIDDLE for line in first_lines
        ),
        'docstrings: first line begins with "What"': sum(
            line.split()[0] == "What" for line in first_lines
        ),
        "docstrings: with Example:": len(examples),
        "docstrings: with Example: and >>>": sum(">>>" in text for text in examples),
    }


def participles(name: str, trees: Sequence[ast.Module]) -> Counts:
    """Places that give a value to a plain name which is a participle.

    These are assignments (each target of a tuple for itself, annotated and augmented ones too),
    and the targets of `for`, `with`, `:=` and comprehensions. Parameters count apart; names of
    which a participle is only a part, and attributes, do not count.
    """
    nodes = [node for tree in trees for node in ast.walk(tree)]
    variables = [node for node in nodes if isinstance(node, ast.Name)]
    stored = Counter(name.id for name in variables if isinstance(name.ctx, ast.Store))
    parameters = Counter(node.arg for node in nodes if isinstance(node, ast.arg))
    return {
        f"{name}: participles of house.md assigned": sum(stored[w] for w in HOUSE_PARTICIPLES),
        f"{name}: participles of house.md as parameters": sum(
            parameters[word] for word in HOUSE_PARTICIPLES
        ),
        f"{name}: further participles assigned": sum(stored[w] for w in FURTHER_PARTICIPLES),
    }


def function_counts(trees: Sequence[ast.Module]) -> Counts:
    """Functions of the package.

    A private helper has a name with one leading underscore. A function's lines go from its `def`
    to its last line, the docstring within. Positional parameters are those that are not keyword
    only, without `self` or `cls` and without `*args`. Positional arguments of a call are counted
    as written, a splat as one; calls of names in capitals and lower-case alike.
    """
    functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, Function)]
    private = sum(re.match(r"_(?!_)", node.name) is not None for node in functions)
    lengths = [(node.end_lineno or node.lineno) - node.lineno + 1 for node in functions]
    calls = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return {
        "functions": len(functions),
        "functions: % private helpers": _percent(private, len(functions)),
        f"functions: over {FUNCTION_LIMIT} lines": sum(n > FUNCTION_LIMIT for n in lengths),
        f"functions: over {POSITIONAL_LIMIT} positional parameters": sum(
            _positional(node) > POSITIONAL_LIMIT for node in functions
        ),
        f"calls with over {POSITIONAL_LIMIT} positional arguments": sum(
            len(node.args) > POSITIONAL_LIMIT for node in calls
        ),
    }


def _positional(function: Function) -> int:
    names = [a.arg for a in (*function.args.posonlyargs, *function.args.args)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def _percent(part: int, whole: int) -> float:
    return round(100 * part / max(whole, 1), 1)
