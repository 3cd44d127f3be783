"""Fail if more than 5 of 1,000 lines of code assign several values at once, as in `a, b = 1, 2`."""

import ast
from pathlib import Path

PAIRED = (ast.Tuple, ast.Tuple)
for room in ("circnav_mav", "sim", "tests"):
    texts = [path.read_text() for path in Path(room).rglob("*.py")]
    lines = sum(bool(line.strip()) for text in texts for line in text.splitlines())
    nodes = (node for text in texts for node in ast.walk(ast.parse(text)))
    parallel = [node for node in nodes if isinstance(node, ast.Assign)]
    count = sum((type(n.targets[0]), type(n.value)) == PAIRED for n in parallel)
    if 1000 * count > 5 * lines:
        raise SystemExit(f"{room}: {count} parallel assignments in {lines} lines: one value a line")
