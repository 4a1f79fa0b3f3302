"""What each role may do at a router, as Zenoh's access control states it."""

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from spot3d_schemas import checked_name

Names = tuple[Annotated[str, AfterValidator(checked_name)], ...]

_ASKED = ["declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"]
"""Kinds of messages that a reader sends."""
_TOLD = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
"""Kinds of messages that a writer sends."""
_BOTH_WAYS = ["ingress", "egress"]
_ANSWERED = ["spot3d/*/fusion/map", "spot3d/*/fusion/changes", "spot3d/*/*/about", "spot3d/*/fusion/objects/@adv/**"]
"""What a dashboard may query: not `fusion/reset`."""


class AccessSettings(BaseModel):
    """Which certificates (their common names) have which role at `spot3d router`, and at the router of a run.

    Where none is named, whoever reaches the router may do everything.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: Names = Field((), description="names of robots: each may publish and receive only under its own name")
    stations: Names = Field(
        (), description="names of ground stations and operators: they may do everything on every robot, including reset"
    )
    dashboards: Names = Field(
        (), description="names of dashboards: they receive everything and may request the map, but publish nothing"
    )
    this_host: bool = Field(
        True, description="allow processes of this host, on tcp/127.0.0.1 or a Unix socket, without a certificate"
    )

    @property
    def enabled(self) -> bool:
        """Whether any role is assigned."""
        return bool(self.robots or self.stations or self.dashboards)


def access_control(access: AccessSettings) -> dict[str, Any]:
    """The `access_control` of a Zenoh router's configuration; everything it does not allow is denied silently.

    A message is filtered where it comes in (ingress) and where it goes out (egress), by the common name of the
    certificate on that link. Readers' requests go to every robot, since a fleet's dashboard asks for all at once
    (`spot3d/*/...`). A robot answers, and is told, only what is under its own name.
    """
    rules = [
        _rule("all", [*_ASKED, *_TOLD], _BOTH_WAYS, ["**", *_keys("**")]),
        _rule(
            "dashboard asks", ["declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"], ["ingress"]
        ),
        _rule("dashboard queries", ["query"], ["ingress"], _ANSWERED),
        _rule("dashboard hears", _TOLD, ["egress"]),
        _rule("robot is asked", _ASKED, ["egress"]),
    ]
    subjects: list[dict[str, Any]] = []
    policies = []
    for name in access.robots:
        rules.append(_rule(f"{name} says", _TOLD, _BOTH_WAYS, _keys(name)))
        rules.append(_rule(f"{name} asks", _ASKED, ["ingress"], _keys(name)))
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"rules": ["robot is asked", f"{name} says", f"{name} asks"], "subjects": [name]})
    if access.stations:
        subjects.append({"id": "stations", "cert_common_names": list(access.stations)})
        policies.append({"rules": ["all"], "subjects": ["stations"]})
    if access.dashboards:
        subjects.append({"id": "dashboards", "cert_common_names": list(access.dashboards)})
        policies.append(
            {"rules": ["dashboard asks", "dashboard queries", "dashboard hears"], "subjects": ["dashboards"]}
        )
    if access.this_host:
        subjects.append({"id": "this host", "interfaces": ["lo", "lo0"], "link_protocols": ["tcp"]})
        subjects.append({"id": "this host's sockets", "link_protocols": ["unixsock-stream"]})
        policies.append({"rules": ["all"], "subjects": ["this host", "this host's sockets"]})
    used = {rule for policy in policies for rule in policy["rules"]}
    return {
        "enabled": access.enabled,
        "default_permission": "deny",
        "rules": [rule for rule in rules if rule["id"] in used],
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str] | None = None) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "messages": messages,
        "flows": flows,
        "key_exprs": _keys("**") if keys is None else keys,
    }


def _keys(robot: str) -> list[str]:
    """Key expressions of a robot; the second is where advanced publishers answer for what they keep."""
    below = "" if robot == "**" else "/**"
    return [f"spot3d/{robot}{below}", f"spot3d/{robot}{below}/@adv/**"]
