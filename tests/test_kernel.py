"""What kernels are compiled with, and without."""

import ast
import importlib
import sys
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


KEPT = """
from typing import NamedTuple
import numpy as np
from spot3d.kernel import kernel
class {name}(NamedTuple):
    values: np.ndarray
@kernel()
def first(given):
    return given.values[0]
"""


def test_what_is_kept_of_another_version_is_compiled_again(tmp_path, monkeypatch):
    """After an update, or on another branch: the class that the cache names is no longer there."""
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("Before", "After"):
        (tmp_path / "kept_kernel.py").write_text(KEPT.format(name=name))
        sys.modules.pop("kept_kernel", None)
        importlib.invalidate_caches()
        module = importlib.import_module("kept_kernel")
        assert module.first(getattr(module, name)(np.array([7.0]))) == 7
    assert list(tmp_path.rglob("kept_kernel.first-*.nbi")), "it is kept at all"


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
