"""A stage never imports another stage: each runs on a device of its own."""

import ast
from pathlib import Path

import pytest

from spot3d_schemas import STAGES

SERVICES = Path(__file__).parents[1] / "services" / "spot3d"
NOT_YET: set[tuple[str, str]] = set()
"""Stages and those that they import all the same, until that is mended."""


def imported(folder: Path) -> set[str]:
    """Stages that the modules in `folder` import from."""
    modules = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {module.split(".")[1] for module in modules if module.startswith("spot3d.")} & set(STAGES)


@pytest.mark.parametrize("stage", STAGES)
def test_no_stage_imports_another(stage: str) -> None:
    assert imported(SERVICES / stage) == {stage}


@pytest.mark.parametrize("shared", ["geometry", "dataflow"])
def test_what_stages_share_imports_no_stage(shared: str) -> None:
    assert imported(SERVICES / shared) == set()
