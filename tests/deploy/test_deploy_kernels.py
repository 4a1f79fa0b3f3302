"""What an image runs while it is built: every stage's kernels are compiled by running its core."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from spot3d_schemas import STAGES


@pytest.fixture(scope="module")
def compile_kernels() -> ModuleType:
    path = Path(__file__).parents[2] / "deploy" / "compile_kernels.py"
    spec = importlib.util.spec_from_file_location("compile_kernels", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("arguments", "said"), [([], "got nothing"), (["fusoin"], "got fusoin"), (["pose", "x"], "got x")]
)
def test_unknown_stages_are_refused(
    compile_kernels: ModuleType, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compile_kernels.main(arguments) == 2
    assert said in capsys.readouterr().err


def test_the_cores_of_all_stages_run(compile_kernels: ModuleType) -> None:
    assert tuple(compile_kernels.STAGES) == STAGES
    assert compile_kernels.main(["all"]) == 0
