"""A stage never imports another stage: each runs on a device of its own. Nor does anything import what it is below."""

import ast
from pathlib import Path

import pytest

from spot3d_schemas import STAGES

SERVICES = Path(__file__).parents[1] / "services" / "spot3d"
TOP_LEVEL = {"pipeline", "settings"}
"""Modules beside the folders that know every stage; whatever stands below the stages knows none of these."""
BELOW_THE_COMMANDS = sorted({path.name for path in SERVICES.iterdir() if (path / "__init__.py").exists()} - {"cli"})


def imported(place: Path) -> set[str]:
    """Folders and modules of spot3d, by their first name, that a module or the modules in a folder import from."""
    modules = set()
    for path in place.rglob("*.py") if place.is_dir() else [place]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {module.split(".")[1] for module in modules if module.startswith("spot3d.")}


@pytest.mark.parametrize("stage", STAGES)
def test_no_stage_imports_another(stage: str) -> None:
    found = imported(SERVICES / stage)
    assert found & set(STAGES) == {stage}
    assert not found & TOP_LEVEL


@pytest.mark.parametrize("shared", ["geometry", "dataflow", "drawing"])
def test_what_stages_share_imports_no_stage(shared: str) -> None:
    assert imported(SERVICES / shared) & {*STAGES, *TOP_LEVEL, "run"} == set()


@pytest.mark.parametrize("folder", BELOW_THE_COMMANDS)
def test_nothing_but_the_program_imports_its_commands(folder: str) -> None:
    assert "cli" not in imported(SERVICES / folder)


@pytest.mark.parametrize("product", sorted({*BELOW_THE_COMMANDS} - {"evaluate", "bench"}))
def test_the_product_imports_nothing_that_measures_it(product: str) -> None:
    assert imported(SERVICES / product) & {"evaluate", "bench"} == set()


def test_modules_beside_the_folders_import_nothing_that_measures_or_runs_them() -> None:
    for module in SERVICES.glob("*.py"):
        if module.name != "__main__.py":
            assert imported(module) & {"evaluate", "bench", "run", "cli"} == set(), module.name


def test_measuring_objects_needs_no_run() -> None:
    assert imported(SERVICES / "evaluate") & {"run", "bench"} == set()
