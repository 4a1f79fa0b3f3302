"""Extras, constraints, the image's recipe and the Makefile fit together."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from spot3d_schemas import STAGES

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
PINS = {
    canonicalize_name(pin.name): pin
    for line in (ROOT / "constraints.txt").read_text().splitlines()
    if not line.startswith("#")
    for pin in [Requirement(line)]
}


@pytest.mark.parametrize(
    "text", sorted({text for texts in (PROJECT["dependencies"], *EXTRAS.values()) for text in texts})
)
def test_every_dependency_has_a_lower_bound_and_a_pin_above_it(text: str) -> None:
    requirement = Requirement(text)
    if requirement.name == PROJECT["name"]:
        assert requirement.extras <= set(EXTRAS)
        return
    assert [bound.operator for bound in requirement.specifier] == [">="]
    (pin,) = PINS[canonicalize_name(requirement.name)].specifier
    assert pin.operator == "=="
    assert requirement.specifier.contains(pin.version)


def test_every_stage_has_an_extra_and_all_has_every_stage() -> None:
    (everything,) = EXTRAS["all"]
    assert Requirement(everything).extras == set(STAGES)
    assert set(STAGES) <= set(EXTRAS)


def test_the_image_copies_what_there_is_and_the_builder_is_sent_no_more() -> None:
    recipe = (ROOT / "deploy" / "Dockerfile").read_text()
    copies = re.findall(r"^COPY (?!--from)(?:--\S+ )*(.+) \S+$", recipe, re.MULTILINE)
    sources = {source for line in copies for source in line.split()}
    assert [source for source in sources if not (ROOT / source).exists()] == []
    assert sources == set(re.findall(r"^!(.+)$", (ROOT / ".dockerignore").read_text(), re.MULTILINE))
    assert re.findall(r"^USER (\S+)", recipe, re.MULTILINE) == ["spot3d"]


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_make_names_the_python_that_it_needs(tmp_path: Path) -> None:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    run = subprocess.run(["make", "PYTHON=false", "install"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "needs Python 3.11 or newer" in run.stderr
    assert not (tmp_path / ".venv").exists()


DISTRIBUTIONS = {"cv2": "opencv-python-headless", "sklearn": "scikit-learn", "zenoh": "eclipse-zenoh"}


def third_party_imports(folder: Path) -> set[str]:
    """Names of the distributions that the modules in `folder` import, canonical."""
    tops = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                tops |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                tops.add(node.module.split(".")[0])
    tops -= {*sys.stdlib_module_names, "spot3d", "spot3d_schemas"}
    return {canonicalize_name(DISTRIBUTIONS.get(top, top)) for top in tops}


@pytest.mark.parametrize("stage", STAGES)
def test_an_extra_holds_all_that_its_stage_imports(stage: str) -> None:
    optional = {"pose": ["gicp"], "source": ["ros", "realsense"]}.get(stage, [])
    texts = [*PROJECT["dependencies"], *EXTRAS[stage], *(text for extra in optional for text in EXTRAS[extra])]
    installed = {canonicalize_name(Requirement(text).name) for text in texts}
    imported = third_party_imports(ROOT / "services" / "spot3d" / stage)
    assert "numpy" in imported
    assert imported <= installed
