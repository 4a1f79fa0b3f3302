"""The package stands alone, and describes itself to clients in other languages."""

import json
import subprocess
import sys

import numpy as np
import pytest

import spot3d_schemas
from spot3d_schemas import MESSAGES, json_schema
from spot3d_schemas.codec import array_fields

OTHERS = """
import sys, sysconfig
from pathlib import Path
before = set(sys.modules)
import spot3d_schemas
site = {Path(sysconfig.get_path(kind)).resolve() for kind in ("purelib", "platlib")}
found = set()
for name in set(sys.modules) - before:
    file = getattr(sys.modules[name], "__file__", None)
    if file and any(folder in Path(file).resolve().parents for folder in site):
        found.add(name.partition(".")[0])
print(*sorted(found))
"""

# pydantic's own requirements come along with it.
ALLOWED = {
    "numpy",
    "msgpack",
    "pydantic",
    "pydantic_core",
    "annotated_types",
    "typing_extensions",
    "typing_inspection",
}


def test_importing_the_package_imports_only_its_three_requirements() -> None:
    done = subprocess.run([sys.executable, "-c", OTHERS], capture_output=True, text=True, check=True)
    found = set(done.stdout.split()) - {"spot3d_schemas"}
    assert {"numpy", "msgpack", "pydantic"} <= found
    assert found <= ALLOWED


def test_all_names_exist() -> None:
    assert all(hasattr(spot3d_schemas, name) for name in spot3d_schemas.__all__)


CORRECTIONS = {"corrected_ns", "corrections"}
ADDED = {
    "Segments": {"left_out"},
    "Objects": {"left_out", "keyframes_dropped", "epoch"},
    "Pose": {
        "epoch",
        "lost_since_ns",
        "T_world_map",
        "depth_factor",
        "delay_s",
        "turn",
        "centre",
        "bend",
        *CORRECTIONS,
    },
    "MapPoints": {"epoch"},
    "MapChanges": {"epoch"},
    "Frame": {"depth_noise"},
    "Heat": {"depth_noise"},
    "Health": {"state", "sent", "sent_bytes"},
}
"""What minor versions have added: older senders leave it out."""


@pytest.mark.parametrize("name", sorted(MESSAGES))
def test_json_schema(name: str) -> None:
    message = MESSAGES[name]
    schema = json.loads(json.dumps(json_schema(message)))
    assert set(schema["properties"]) == set(message.model_fields)
    assert set(schema["properties"]) - set(schema["required"]) == ADDED.get(name, set())
    header = schema["$defs"]["Header"]
    assert header["properties"]["schema"] == {"const": f"spot3d.{name}"}
    assert {"schema", "version", "stamp_ns"} <= set(header["required"])
    for field, spec in array_fields(message).items():
        described = schema["properties"][field]
        assert described["required"] == ["dtype", "shape", "encoding", "data"]
        assert described["properties"]["dtype"] == {"enum": list(spec.dtypes)}
        assert described["properties"]["shape"]["minItems"] == len(spec.axes)
        said = described["properties"]["data"]["description"]
        assert all(f"{encoding}: " in said for encoding in described["properties"]["encoding"]["enum"])


def test_json_schema_states_row_major_matrices() -> None:
    pose = json_schema(MESSAGES["Pose"])["properties"]["T_world_camera"]
    assert (pose["minItems"], pose["maxItems"]) == (np.eye(4).size, 16)
    assert "row-major" in pose["description"]
