"""Converts objects of known classes to plain values and arrays, and back, for snapshots of a core's state.

Whatever a file says, no code is run, and only objects of classes that the reader names are made.
"""

from collections import Counter, OrderedDict, deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Classes = Mapping[str, type]
_LISTS: dict[str, Any] = {"list": list, "tuple": tuple, "set": set, "deque": deque}
_MAPS: dict[str, Any] = {"dict": dict, "Counter": Counter, "OrderedDict": OrderedDict}


def saved(value: object, arrays: dict[str, NDArray[Any]], classes: Classes, given: object) -> Any:
    """`value` as a JSON-serialisable structure; its arrays go to `arrays`, each under a name of its own.

    classes: those of the objects in it, by name. given: an object that is not saved, but supplied again by the reader.
    Raises TypeError for anything of another kind.
    """
    if value is given:
        return {"given": True}
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray):
        name = str(len(arrays))
        arrays[name] = value
        return {"array": name}
    if isinstance(value, np.generic):
        name = str(len(arrays))
        arrays[name] = np.array(value)
        return {"scalar": name}
    kind = type(value)
    if isinstance(value, dict) and _MAPS.get(kind.__name__) is kind:
        pairs = [[saved(part, arrays, classes, given) for part in pair] for pair in value.items()]
        return {kind.__name__: pairs}
    if isinstance(value, list | tuple | set | deque) and _LISTS.get(kind.__name__) is kind:
        return {kind.__name__: [saved(item, arrays, classes, given) for item in value]}
    if classes.get(kind.__name__) is kind:
        fields = {name: saved(getattr(value, name), arrays, classes, given) for name in _field_names(value)}
        return {"object": kind.__name__, "fields": fields}
    raise TypeError(f"{kind.__name__} cannot be saved")


def restored(said: Any, arrays: Mapping[str, NDArray[Any]], classes: Classes, given: object) -> Any:
    """Inverse of `saved`. Raises ValueError for what `saved` has not returned for these classes."""
    if not isinstance(said, dict):
        return said
    try:
        if "object" in said:
            made: Any = object.__new__(classes[said["object"]])
            for name, value in said["fields"].items():
                object.__setattr__(made, name, restored(value, arrays, classes, given))
            return made
        ((kind, held),) = said.items()
        if kind == "given":
            return given
        if kind == "float":
            return float(held)
        if kind == "array":
            return arrays[held]
        if kind == "scalar":
            return arrays[held][()]
        if kind in _LISTS:
            return _LISTS[kind](restored(item, arrays, classes, given) for item in held)
        pairs = [[restored(part, arrays, classes, given) for part in pair] for pair in held]
        return _MAPS[kind](dict(pairs))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"the saved state is of another version ({error})") from error


def same_fields(one: object, other: object) -> bool:
    """Whether two objects, and the objects that both hold, have the same attribute names, as in one version."""
    names = _field_names(one)
    if type(one) is not type(other) or set(names) != set(_field_names(other)):
        return False
    pairs = ((getattr(one, name), getattr(other, name)) for name in names)
    return all(same_fields(a, b) for a, b in pairs if type(a) is type(b) and hasattr(a, "__dict__"))


def _field_names(value: object) -> list[str]:
    if hasattr(value, "__dict__"):
        # Attributes that typing adds to a generic class's object are not part of its state.
        return [name for name in vars(value) if not name.startswith("__")]
    return [name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ()) if hasattr(value, name)]
