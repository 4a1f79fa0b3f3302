"""What kernels are compiled with, and without."""

import ast
from pathlib import Path

import numpy as np

import spot3d
from spot3d.kernel import kernel, part


@part()
def half(x):
    return x / 2


@kernel(cache=False)
def halves(values):
    out = np.empty(len(values))
    for i in range(len(values)):
        out[i] = half(values[i]) / (i - 1)
    return out


def test_a_kernel_takes_in_its_parts_and_divides_as_numpy_does():
    np.testing.assert_array_equal(halves(np.array([2.0, 2.0, 2.0])), [-1, np.inf, 1])
    assert half(3) == 1.5, "a part is plain Python outside of kernels"


def test_a_kernel_has_one_entry_from_python_and_none_for_c_code():
    halves(np.zeros(1))
    compiled = halves.overloads[halves.signatures[0]].library.get_llvm_str()
    assert "cpython" in compiled
    assert "cfunc" not in compiled


def test_no_kernel_has_more_than_eight_parameters():
    counts = {}
    for path in Path(spot3d.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any(map(_compiles, node.decorator_list)):
                counts[f"{path.stem}.{node.name}"] = len(node.args.args)
    assert len(counts) > 80, "the kernels are found at all"
    assert [name for name, count in counts.items() if count > 8] == []


def _compiles(decorator: ast.expr) -> bool:
    return isinstance(decorator, ast.Call) and ast.unparse(decorator.func) in ("kernel", "part")
